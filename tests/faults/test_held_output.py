"""A port that sends slowly, or not at all for a while: stops overtake, and an end is honest.

On virtual time, behind a model of the queue that a serial driver has. A pseudo-terminal has a queue
too, but tells nothing of it.
"""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from fault_bench import DIALECTS, MS, holds_stop
from kernel_queue import Line, QueueingBench

from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time

LONGEST_FRAME = 51


def robot(folder: Path, dialect: str, line: Line) -> QueueingBench:
    simulation = SimulationOptions(dialect=dialect)  # type: ignore[arg-type]
    return QueueingBench(folder, line, simulation=simulation)


async def ended(bench: QueueingBench) -> None:
    bench.tasks[0].cancel()
    await asyncio.gather(bench.tasks[0], return_exceptions=True)


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("rate", [100.0, 200.0, 1000.0])
@on_virtual_time
async def test_behind_a_slow_port_a_stop_waits_for_one_frame_at_most(
    tmp_path: Path, dialect: str, rate: float
) -> None:
    line = Line()
    async with robot(tmp_path, dialect, line) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.4)
        line.bytes_per_s = rate
        for index in range(20):
            # Each differs from the one before: none is left out as a repetition.
            bench.command(0.4 + 0.001 * (index % 2))
            await asyncio.sleep(0.05)
        await asyncio.sleep(0.037)
        assert line.ports[-1].queued() <= LONGEST_FRAME
        before_ns = bench.clock.now_ns()
        bench.operator.engage_estop("a test")
        await asyncio.sleep(3.0)
        assert bench.standing
        # A frame that is under way, the distance to the next, the stop, and the wheels' own.
        took_ns = bench.stood_at(before_ns) - before_ns
        assert took_ns <= (2 * 26 / rate + 0.4) * 1e9, took_ns / 1e9
        if rate < 1000:
            assert "bytes/s of 11520" in bench.events("port_slow")[0]


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("drops", [True, False], ids=["uart", "usb"])
@pytest.mark.parametrize("stall_s", [0.1, 0.29, 0.5, 1.0, 1.5, 2.0])
@on_virtual_time
async def test_an_end_while_the_output_stalls_waits_for_it_and_sees_the_wheels_stand(
    tmp_path: Path, dialect: str, drops: bool, stall_s: float
) -> None:
    line = Line(drops=drops)
    async with robot(tmp_path, dialect, line) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.4)
        line.stall(stall_s)
        await ended(bench)
        assert bench.supervisor.left_standing
        assert bench.standing
        await asyncio.sleep(5.0)
        assert bench.standing
        assert bench.events("stop_not_seen") == []


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("drops", [True, False], ids=["uart", "usb"])
@on_virtual_time
async def test_an_end_on_a_port_that_never_sends_is_bounded_and_claims_nothing(
    tmp_path: Path, dialect: str, drops: bool
) -> None:
    line = Line(drops=drops)
    async with robot(tmp_path, dialect, line) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.4)
        line.stall(3600.0)
        before_ns = bench.clock.now_ns()
        await ended(bench)
        assert bench.clock.now_ns() - before_ns < 4000 * MS
        assert not bench.supervisor.left_standing
        assert "the port did not take all of it" in bench.events("stop_not_seen")[0]


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("drops", [True, False], ids=["uart", "usb"])
@pytest.mark.parametrize("stall_s", [0.1, 0.25, 0.5, 1.0, 2.0])
@on_virtual_time
async def test_after_a_stall_no_motion_follows_a_stop_that_was_engaged_during_it(
    tmp_path: Path, dialect: str, drops: bool, stall_s: float
) -> None:
    for phase_ms in (0, 23):
        folder = tmp_path / str(phase_ms)
        folder.mkdir()
        line = Line(drops=drops)
        async with robot(folder, dialect, line) as bench:
            await bench.ready()
            await bench.drive(1.0, 0.4)
            line.stall(stall_s)
            await asyncio.sleep(phase_ms / 1000)
            bench.operator.engage_estop("a test")
            await asyncio.sleep(stall_s + 1.5)
            assert bench.standing
            stood_ns = bench.clock.now_ns()
            await asyncio.sleep(1.0)
            assert bench.fastest_since(stood_ns) < 0.03


QUEUES = {
    # If the queue is seen, the port is opened again after 0.3 s, and then every second.
    "uart": (True, True, [0.31, 0.4, 1.4, 1.5, 2.7, 2.9]),
    "usb": (False, True, [0.31, 0.4, 1.4, 1.5, 2.7, 2.9]),
    # If not, a polled board is silent, and the session with it ends.
    "pty": (True, False, [1.88, 1.9, 1.92, 1.94, 1.96, 1.98]),
}


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize(
    ("queue", "stall_s"), [(queue, s) for queue, (*_, stalls_s) in QUEUES.items() for s in stalls_s]
)
@on_virtual_time
async def test_whenever_a_stall_ends_an_estop_engaged_during_it_is_on_the_wire_at_once(
    tmp_path: Path, dialect: str, queue: str, stall_s: float
) -> None:
    drops, tells, _ = QUEUES[queue]
    line = Line(drops=drops, tells=tells)
    async with robot(tmp_path, dialect, line) as bench:
        await bench.ready()
        await bench.drive(5.5, 0.35)
        line.stall(stall_s)
        ends_ns = bench.clock.now_ns() + round(stall_s * 1e9)
        await bench.drive(0.1, 0.35)
        bench.operator.engage_estop("a test")
        await asyncio.sleep(stall_s + 0.5)
        stops_ns = [at_ns for at_ns, data in line.sent if at_ns >= ends_ns and holds_stop(data)]
        assert stops_ns[0] - ends_ns < 20 * MS


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("rate", [100.0, 200.0])
@on_virtual_time
async def test_an_end_behind_a_slow_port_sees_the_wheels_stand(
    tmp_path: Path, dialect: str, rate: float
) -> None:
    line = Line()
    async with robot(tmp_path, dialect, line) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.4)
        line.bytes_per_s = rate
        await bench.drive(1.0, 0.4)
        await ended(bench)
        assert bench.standing


@on_virtual_time
async def test_a_port_that_is_lost_leaves_wheels_that_stood_unless_they_turned(
    tmp_path: Path,
) -> None:
    async with robot(tmp_path, "streamed", Line()) as bench:
        await bench.ready()
        for standing_s, stood in ((2.0, True), (0.0, False)):
            await bench.drive(1.0, 0.4)
            await asyncio.sleep(standing_s)
            bench.do("unplug")
            await asyncio.sleep(1.0)
            assert bench.supervisor.left_standing == stood
            bench.do("replug")
            await bench.ready()
        await asyncio.sleep(1.0)
        await ended(bench)
        assert bench.supervisor.left_standing
