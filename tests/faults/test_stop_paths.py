"""However driving ends, the wheels are stopped, and the stop is verified.

On virtual time: every figure here is exact, on every machine.
"""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
from binary_dialect import BINARY
from fault_bench import (
    CUT,
    EVERY_DIALECT,
    MS,
    ROSMASTER,
    STREAMS,
    SUREST,
    FaultBench,
    first_stop_ns,
    is_stop,
)
from robot_bench import state_and_why

from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time

BRAKE = b"$spd:0,0,0,0#"
BRAKES = {"streamed": BRAKE, "rosmaster": ROSMASTER.brake, "binary": BINARY.brake}

End = Callable[[FaultBench], Awaitable[None]]


def robot(tmp_path: Path, *overrides: str, **simulation: object) -> FaultBench:
    return FaultBench(tmp_path, overrides, SimulationOptions(**simulation))  # type: ignore[arg-type]


# Each way to end a drive. The consequences are the same for all.


async def estop(bench: FaultBench) -> None:
    bench.operator.engage_estop("a test")


async def lost_bus(bench: FaultBench) -> None:
    bench.controller.bus_lost()


async def asked_to_end(bench: FaultBench) -> None:
    bench.tasks[0].cancel()


async def control_path_fails(bench: FaultBench) -> None:
    session = bench.supervisor.session
    assert session is not None
    session.board._poller._on_reading = lambda _: 1 / 0  # type: ignore[union-attr]


async def session_task_cancelled(bench: FaultBench) -> None:
    next(task for task in asyncio.all_tasks() if task.get_name() == "link-writer").cancel()


async def port_watch_cancelled(bench: FaultBench) -> None:
    next(task for task in asyncio.all_tasks() if task.get_name() == "port-watch").cancel()


AT_ONCE = [
    estop,
    lost_bus,
    asked_to_end,
    control_path_fails,
    session_task_cancelled,
    port_watch_cancelled,
]


GENTLE = (
    "limits.linear={velocity=1.0,acceleration=2.5,deceleration=0.1}",
    "command.on_timeout=ramp",
)
"""Only silence may ramp down."""


@pytest.mark.cases(3)
@pytest.mark.parametrize("dialect", EVERY_DIALECT)
@pytest.mark.parametrize("end", AT_ONCE)
@on_virtual_time
async def test_the_stop_is_on_the_wire_within_50_ms_however_gentle_the_limits_and_nothing_follows(
    tmp_path: Path, dialect: str, end: End
) -> None:
    for phase_ms in (1, 34, 85):
        folder = tmp_path / str(phase_ms)
        folder.mkdir()
        async with robot(folder, *GENTLE, dialect=dialect) as bench:
            await bench.ready()
            await bench.drive(1.0, 0.4)
            # Another speed waits its turn.
            bench.command(0.35)
            await asyncio.sleep(phase_ms / 1000)
            now_ns = bench.clock.now_ns()
            await end(bench)
            await asyncio.sleep(0.6)
            orders = bench.orders_since(now_ns)
            stop_ns = first_stop_ns(orders)
            assert stop_ns - now_ns <= 50 * MS
            if end is not control_path_fails:
                # Whose first failure comes with the next reading.
                assert is_stop(orders[0][1])
            assert all(is_stop(order) for at_ns, order in orders if at_ns >= stop_ns)
            # At 0.1 m/s^2 it would have taken four seconds.
            assert bench.standing
            for task in bench.tasks:
                await asyncio.gather(task, return_exceptions=True) if task.done() else None


@pytest.mark.cases(2)
@pytest.mark.parametrize("end", AT_ONCE)
@pytest.mark.parametrize(("dialect", "last"), SUREST.items())
@on_virtual_time
async def test_every_way_out_ends_with_the_motors_let_go_and_all_of_it_on_the_wire(
    tmp_path: Path, dialect: str, last: bytes, end: End
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        await bench.drive(0.5, 0.4)
        session = bench.supervisor.session
        assert session is not None
        await end(bench)
        await asyncio.sleep(0.1)
        bench.tasks[0].cancel()
        await asyncio.gather(bench.tasks[0], return_exceptions=True)
        assert bench.orders[-1][1] == last
        assert session.report is not None
        assert session.report.stood is True
        assert session.report.flushed
        assert bench.ports[-1].closed
        assert bench.standing


@pytest.mark.cases(1)
@pytest.mark.parametrize("end", [estop, lost_bus])
@pytest.mark.parametrize("dialect", STREAMS)
@on_virtual_time
async def test_a_stop_is_said_again_until_the_wheels_stand_and_cut_after_600_ms(
    tmp_path: Path, end: End, dialect: str
) -> None:
    # Otherwise a wheel that rolls on after its cut is held once more before it is accused.
    async with robot(tmp_path, "command.at_rest=hold", dialect=dialect) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        bench.do("turning left 0.08")
        now_ns = bench.clock.now_ns()
        await end(bench)
        await asyncio.sleep(2.0)
        orders = bench.orders_since(now_ns)
        braked = [at_ns for at_ns, order in orders if order == BRAKES[dialect]]
        cut_ns = next(at_ns for at_ns, order in orders if order == SUREST[dialect])
        assert len(braked) >= 6
        assert max(b - a for a, b in itertools.pairwise(braked)) <= 110 * MS
        assert 600 * MS <= cut_ns - now_ns <= 650 * MS
        # And no brake takes the cut back.
        assert braked[-1] < cut_ns
        assert any(event.wheel == "left" for event in bench.heard.events)
        assert "still turns" in bench.events("stop_not_obeyed")[0]


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", EVERY_DIALECT)
@on_virtual_time
async def test_wheels_of_a_crash_are_stopped_however_early_the_connecting_is_broken_off(
    tmp_path: Path, dialect: str
) -> None:
    words = {
        "streamed": b"$spd:300,0,300,0#",
        "polled": b"$mtype:1#$speed:300,0,300,0#",
        "rosmaster": ROSMASTER.speeds((300, 0, 0)),
        "binary": BINARY.speeds((300, 0, 0)),
    }
    for phase_ms in [1, 10, 50, 150, 300]:
        folder = tmp_path / str(phase_ms)
        folder.mkdir()
        bench = robot(folder, dialect=dialect)
        bench.robot.start(bench.clock.now_ns())
        bench.robot.host_wrote(words[dialect], bench.clock.now_ns())
        await asyncio.sleep(1.0)
        assert min(bench.rim_speeds) > 0.2
        async with bench:
            await asyncio.sleep(phase_ms / 1000)
            assert bench.ports
        await asyncio.sleep(1.0)
        assert bench.standing
        assert bench.ports[0].closed


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", STREAMS)
@on_virtual_time
async def test_a_stop_under_way_is_not_broken_off_by_being_asked_again(
    tmp_path: Path, dialect: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        await bench.drive(0.5, 0.4)
        for _ in range(20):
            bench.tasks[0].cancel()
            await asyncio.sleep(0.007)
        await asyncio.gather(bench.tasks[0], return_exceptions=True)
        surest = SUREST[dialect]
        end = [CUT, b"$upload:0,0,0#", CUT] if dialect == "streamed" else [surest, surest]
        assert bench.frames[-len(end) :] == end
        assert bench.standing


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", STREAMS)
@on_virtual_time
async def test_a_stop_at_the_end_that_was_not_seen_obeyed_is_reported(
    tmp_path: Path, dialect: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        await bench.drive(0.5, 0.4)
        bench.do("hang")
        bench.tasks[0].cancel()
        await asyncio.gather(bench.tasks[0], return_exceptions=True)
        assert "no counts showed whether they stand" in bench.events("stop_not_seen")[0]


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", EVERY_DIALECT)
@pytest.mark.parametrize("end", [asked_to_end, session_task_cancelled, port_watch_cancelled])
@on_virtual_time
async def test_wheels_that_the_end_stops_are_not_accused_of_disobeying_the_application(
    tmp_path: Path, dialect: str, end: End
) -> None:
    # The right wheel stands on the spot; the left one is turned by hand, so the stop takes long.
    async with robot(tmp_path, dialect=dialect, time_constant_s=0.01) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.4)
        assert min(bench.rim_speeds) > 0.2
        bench.heard.events.clear()
        bench.do("turning left 0.08")
        await end(bench)
        # The application does not know, and commands on.
        await bench.drive(0.5, 0.4)
        assert set(bench.heard.kinds) <= {"stop_not_seen", "disconnected"}
        state, why = state_and_why(bench.controller)
        assert state == "waiting"
        assert "being ended" in why
