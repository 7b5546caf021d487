from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable
from typing import Any

import pytest

from yahboomd.core.clock import Schedule
from yahboomd.simulation import virtual_time
from yahboomd.simulation.virtual_time import (
    START_NS,
    Deadlock,
    LoopClock,
    VirtualTimeLoop,
    on_virtual_time,
    run,
)


def test_an_hour_passes_in_no_time() -> None:
    async def main() -> float:
        loop = asyncio.get_running_loop()
        start = loop.time()
        await asyncio.sleep(3600)
        return loop.time() - start

    before = time.monotonic()
    assert run(main()) == pytest.approx(3600)
    assert time.monotonic() - before < 60


def test_what_is_due_while_the_loop_is_frozen_runs_late_and_in_order() -> None:
    async def main() -> list[tuple[str, float]]:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)
        start, rang = loop.time(), []
        for name, delay in (("b", 0.2), ("a", 0.1), ("c", 3.0)):
            loop.call_later(delay, lambda name=name: rang.append((name, loop.time() - start)))
        loop.freeze(2.0)
        await asyncio.sleep(1.5)
        return rang

    rang = run(main())
    assert [name for name, _ in rang] == ["a", "b", "c"]
    assert [at for _, at in rang] == pytest.approx([2.0, 2.0, 3.0], abs=1e-6)


def test_timers_run_in_order_and_at_their_time() -> None:
    async def main() -> list[tuple[str, float]]:
        loop = asyncio.get_running_loop()
        start, rang = loop.time(), []
        for name, delay in (("c", 0.3), ("a", 0.1), ("b", 0.2)):
            loop.call_later(delay, lambda name=name: rang.append((name, loop.time() - start)))
        await asyncio.sleep(0.5)
        return rang

    rang = run(main())
    assert [name for name, _ in rang] == ["a", "b", "c"]
    assert [at for _, at in rang] == pytest.approx([0.1, 0.2, 0.3], abs=1e-8)


def test_time_does_not_start_at_zero() -> None:
    async def main() -> int:
        return LoopClock().now_ns()

    assert run(main()) == START_NS


@on_virtual_time
async def test_schedules_keep_exact_time() -> None:
    schedule = Schedule(LoopClock(), 20_000_000)
    try:
        beats = [await schedule.beat() for _ in range(100)]
        assert beats[-1] - beats[0] == 99 * 20_000_000
        assert schedule.missed == 0
    finally:
        schedule.close()


def test_a_decorated_test_keeps_its_arguments() -> None:
    @on_virtual_time
    async def add(a: int, *, b: int) -> int:
        await asyncio.sleep(1)
        return a + b

    assert add(1, b=2) == 3


def test_waiting_for_what_never_comes_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(virtual_time, "REAL_PATIENCE_S", 0.01)

    async def main() -> None:
        await asyncio.get_running_loop().create_future()

    with pytest.raises(Deadlock):
        run(main())


def test_a_thread_can_wake_the_loop() -> None:
    async def main() -> str:
        loop = asyncio.get_running_loop()
        woken: asyncio.Future[str] = loop.create_future()
        thread = threading.Thread(
            target=lambda: loop.call_soon_threadsafe(woken.set_result, "woken")
        )
        thread.start()
        result = await woken
        thread.join()
        return result

    assert run(main()) == "woken"


def test_a_task_left_behind_is_an_error_that_names_it() -> None:
    async def main() -> None:
        asyncio.get_running_loop().create_task(asyncio.sleep(1000), name="forgotten")

    with pytest.raises(RuntimeError, match="forgotten"):
        run(main())


def test_the_fixture_runs_coroutines(virtual_time_run: Callable[[Any], Any]) -> None:
    assert virtual_time_run(asyncio.sleep(100, result="done")) == "done"
