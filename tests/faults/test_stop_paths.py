"""However driving ends, the wheels are told to stop, and the stop is seen through.

On virtual time: every figure here is exact, on every machine.
"""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from fault_bench import DIALECTS, MS, FaultBench, first_stop_ns, is_stop

from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time

STILL_M_S = 0.03


def robot(tmp_path: Path, *overrides: str, **simulation: object) -> FaultBench:
    return FaultBench(tmp_path, overrides, SimulationOptions(**simulation))  # type: ignore[arg-type]


# Each way to end a drive that is under way. What follows each is the same for all.


async def estop(bench: FaultBench) -> None:
    bench.operator.engage_estop("a test")


async def lost_bus(bench: FaultBench) -> None:
    bench.controller.bus_lost()


async def told_to_end(bench: FaultBench) -> None:
    bench.tasks[0].cancel()


async def control_path_fails(bench: FaultBench) -> None:
    session = bench.supervisor.session
    assert session is not None
    session._poller._on_reading = lambda _: 1 / 0  # type: ignore[union-attr]


async def session_task_cancelled(bench: FaultBench) -> None:
    next(task for task in asyncio.all_tasks() if task.get_name() == "link-writer").cancel()


async def port_watch_cancelled(bench: FaultBench) -> None:
    next(task for task in asyncio.all_tasks() if task.get_name() == "port-watch").cancel()


AT_ONCE = [
    estop,
    lost_bus,
    told_to_end,
    control_path_fails,
    session_task_cancelled,
    port_watch_cancelled,
]


@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("end", AT_ONCE)
@on_virtual_time
async def test_the_stop_is_on_the_wire_within_50_ms_and_nothing_moves_after_it(
    tmp_path: Path, dialect: str, end: object
) -> None:
    for phase_ms in range(0, 100, 7):
        folder = tmp_path / str(phase_ms)
        folder.mkdir()
        async with robot(folder, dialect=dialect) as bench:
            await bench.ready()
            await bench.drive(1.0, 0.4)
            bench.command(0.4)
            await asyncio.sleep(phase_ms / 1000)
            now_ns = bench.clock.now_ns()
            await end(bench)  # type: ignore[operator]
            await asyncio.sleep(0.6)
            orders = bench.orders_since(now_ns)
            stop_ns = first_stop_ns(orders)
            assert stop_ns - now_ns <= 50 * MS
            assert all(is_stop(order) for at_ns, order in orders if at_ns >= stop_ns)
            assert bench.standing
            for task in bench.tasks:
                await asyncio.gather(task, return_exceptions=True) if task.done() else None


@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_a_speed_that_waits_its_turn_is_not_said_after_the_last_stop(
    tmp_path: Path, dialect: str
) -> None:
    for phase_ms in range(20):
        folder = tmp_path / str(phase_ms)
        folder.mkdir()
        async with robot(folder, dialect=dialect) as bench:
            await bench.ready()
            await bench.drive(0.5, 0.2)
            await asyncio.sleep(phase_ms / 1000)
            bench.command(0.4)
            now_ns = bench.clock.now_ns()
            bench.tasks[0].cancel()
            await asyncio.sleep(0.8)
            orders = bench.orders_since(now_ns + 1)
            assert orders
            assert all(is_stop(order) for _, order in orders)
