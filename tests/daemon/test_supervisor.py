"""Reconnecting: for ever, with patience, and without a word too many."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

import pytest

from yahboomd.clock import LoopClock
from yahboomd.daemon.supervisor import BACK_OFF_S, Supervisor
from yahboomd.errors import LinkError, PortDenied, PortLost, PortMissing, YahboomdError
from yahboomd.simulation.virtual_time import on_virtual_time


class Missing:
    """A session that finds no port."""

    identity: object | None = None

    def __init__(self, error: Callable[[], LinkError] | None = None) -> None:
        self._error = error or (lambda: PortMissing("/dev/x: there is no such port."))

    async def run(self) -> None:
        raise self._error()

    left_standing: bool | None = None

    def facts(self) -> dict[str, int]:
        return {"bytes": 1}


class Watcher:
    def __init__(self) -> None:
        self.searches: list[int] = []
        self.errors: list[YahboomdError] = []

    def searching(self) -> None:
        self.searches.append(LoopClock().now_ns())

    def unavailable(self, error: YahboomdError) -> None:
        self.errors.append(error)


async def run_for(supervisor: Supervisor, for_s: float) -> None:
    task = asyncio.create_task(supervisor.run())
    await asyncio.sleep(for_s)
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


@on_virtual_time
async def test_a_missing_port_is_looked_for_with_bounded_back_off_for_ever() -> None:
    watcher = Watcher()
    supervisor = Supervisor(Missing, LoopClock(), watcher)  # type: ignore[arg-type]
    await run_for(supervisor, 600.0)
    waits = [b - a for a, b in zip(watcher.searches, watcher.searches[1:], strict=False)]
    assert waits[: len(BACK_OFF_S)] == pytest.approx([s * 1e9 for s in BACK_OFF_S], rel=1e-6)
    assert max(waits) <= BACK_OFF_S[-1] * 1e9 * 1.000001
    # About one attempt a second: no spinning, and no giving up.
    assert 590 < len(watcher.searches) < 610


def test_the_same_fault_is_told_once_and_counted(caplog: pytest.LogCaptureFixture) -> None:
    @on_virtual_time
    async def scene() -> Supervisor:
        supervisor = Supervisor(Missing, LoopClock(), Watcher())  # type: ignore[arg-type]
        await run_for(supervisor, 3600.0)
        return supervisor

    with caplog.at_level(logging.INFO, logger="yahboomd"):
        supervisor = scene()
    assert caplog.text.count("no such port") == 1
    assert supervisor.counters["repeated_faults"] > 3000


def test_a_port_that_udev_has_not_yet_handed_over_is_no_news(
    caplog: pytest.LogCaptureFixture,
) -> None:
    errors: list[LinkError] = [
        PortMissing("/dev/x: there is no such port."),
        PortDenied("/dev/x: this user may not open the port."),
    ]

    @on_virtual_time
    async def scene(more: list[LinkError]) -> None:
        answers = [*errors, *more]
        sessions = Missing(lambda: answers.pop(0) if answers else errors[0])
        supervisor = Supervisor(lambda: sessions, LoopClock(), Watcher())  # type: ignore[arg-type, return-value]
        await run_for(supervisor, 10.0)

    with caplog.at_level(logging.INFO, logger="yahboomd"):
        scene([])
    assert "may not open" not in caplog.text
    with caplog.at_level(logging.INFO, logger="yahboomd"):
        scene([errors[1]])
    assert caplog.text.count("may not open") == 1


@on_virtual_time
async def test_after_a_good_session_the_next_attempt_comes_soon() -> None:
    class Steady(Missing):
        identity = object()

        async def run(self) -> None:
            await asyncio.sleep(10.0)
            raise PortLost("/dev/x: the port went away.")

    watcher = Watcher()
    await run_for(Supervisor(Steady, LoopClock(), watcher), 35.0)  # type: ignore[arg-type]
    gaps = [b - a for a, b in zip(watcher.searches, watcher.searches[1:], strict=False)]
    assert all(gap < 10.2e9 for gap in gaps)


@on_virtual_time
async def test_a_port_that_goes_away_while_it_is_asked_to_end_does_not_keep_it() -> None:
    class Losing(Missing):
        async def run(self) -> None:
            try:
                await asyncio.sleep(1000.0)
            except asyncio.CancelledError:
                # What a task group does with a cancellation that an error overtakes.
                raise PortLost("/dev/x: the port went away.") from None

    task = asyncio.create_task(
        Supervisor(Losing, LoopClock(), Watcher()).run()  # type: ignore[arg-type]
    )
    await asyncio.sleep(1.0)
    task.cancel()
    done, _ = await asyncio.wait([task], timeout=1.0)
    assert done
    assert task.cancelled()


@on_virtual_time
async def test_the_counters_of_ended_sessions_are_kept() -> None:
    supervisor = Supervisor(Missing, LoopClock(), Watcher())  # type: ignore[arg-type]
    await run_for(supervisor, 10.0)
    assert supervisor.facts()["bytes"] == supervisor.counters["attempts"]


@on_virtual_time
async def test_an_error_of_the_program_is_not_retried() -> None:
    def broken() -> LinkError:
        raise ZeroDivisionError

    supervisor = Supervisor(lambda: Missing(broken), LoopClock(), Watcher())  # type: ignore[arg-type, return-value]
    with pytest.raises(ZeroDivisionError):
        await supervisor.run()
