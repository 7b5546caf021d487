"""What reports a stop follows the bytes of the stop; on virtual time."""

from __future__ import annotations

import asyncio
import errno
from pathlib import Path

import pytest
from robot_bench import RobotBench

from yahboomd.core.daemon.estop.stop_reports import WITHIN_S, StopReports
from yahboomd.core.model import Event
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.simulation.motors import MotorFaults
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.virtual_time import LoopClock, VirtualTimeLoop, on_virtual_time

AFTER_MS = range(0, 40, 15)
"""From a command to the stop: the line is free, or waits for the distance between two frames."""


class Watched(RobotBench):
    """Notes the last frame on the wire when the stop was reported.

    Attributes:
        reported: The kind of each event, and whether the last frame then was a stop.
    """

    def __init__(self, folder: Path, dialect: str) -> None:
        super().__init__(folder, simulation=SimulationOptions(dialect=dialect))
        self.reported: list[tuple[str, bool]] = []
        hear = self.heard.event

        def event(event: Event) -> None:
            self.reported.append((event.kind, self.stopped))
            hear(event)

        self.heard.event = event  # type: ignore[method-assign]

    @property
    def stopped(self) -> bool:
        """Whether the last frame that moves wheels is a stop."""
        assert self.port is not None
        dialect = DIALECTS[self.robot.options.dialect]
        stops = {each for each in (dialect.brake, dialect.cut) if each is not None}
        quiet = {*stops, *dialect.arm, dialect.poll, dialect.battery}
        frames = [frame for frame in self.frames if frame in stops or frame not in quiet]
        return frames[-1] in stops


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_answer_event_and_state_of_an_emergency_stop_follow_its_bytes(
    tmp_path: Path, dialect: str
) -> None:
    async with Watched(tmp_path, dialect) as bench:
        await bench.ready()
        waited = 0
        for after_ms in AFTER_MS:
            await bench.drive(0.4, 0.3)
            written = len(bench.frames)
            bench.command(0.3 + after_ms / 1000)
            await asyncio.sleep(after_ms / 1000)
            if after_ms == 0:
                # While the frame is on the wire the line of every board is taken.
                await bench.until(lambda written=written: len(bench.frames) > written)
            assert not bench.stopped
            words = bench.operator.engage_estop("a test")
            waited += not bench.stopped
            # The disk works in real time.
            assert any(bench.latch.settle() for _ in range(40))
            asked_ns = bench.clock.now_ns()
            asking = asyncio.create_task(bench.operator.acknowledged(words))
            while not asking.done():
                assert bench.stopped or bench.controller.state()[0] == "stopping"
                await asyncio.sleep(0.0005)
            answer = asking.result()
            assert bench.stopped
            assert answer.success
            # The counts follow later.
            assert answer.data["stands"] is False
            assert answer.data["fastest_m_s"] > 0.1
            assert bench.clock.now_ns() - asked_ns < 50_000_000
            assert bench.controller.state()[0] == "estopped"
            assert bench.reported[-1] == ("estop", True)
            await asyncio.sleep(1.1)
            again = await bench.operator.acknowledged(bench.operator.engage_estop("a test"))
            assert again.success
            assert again.data["fastest_m_s"] == 0.0
            assert bench.operator.release_estop()[0]
        # Else this shows nothing.
        assert waited


@on_virtual_time
async def test_a_stop_on_a_port_that_takes_no_output_is_answered_with_the_reason(
    tmp_path: Path,
) -> None:
    async with Watched(tmp_path, "streamed") as bench:
        await bench.ready()
        await bench.drive(0.5, 0.3)
        assert bench.port is not None
        bench.port.waiting = 17
        words = bench.operator.engage_estop("a test")
        assert any(bench.latch.settle() for _ in range(40))
        asked_ns = bench.clock.now_ns()
        answer = await bench.operator.acknowledged(words)
        assert bench.clock.now_ns() - asked_ns <= WITHIN_S * 1e9
        assert not answer.success
        assert answer.data["sent"] is False
        assert "It could not be sent, because" in answer.message
        (words,) = [each.message for each in bench.heard.events if each.kind == "estop"]
        assert words == answer.message


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_a_stop_that_waited_in_a_frozen_process_is_answered_once_it_was_sent(
    tmp_path: Path, dialect: str
) -> None:
    async with Watched(tmp_path, dialect) as bench:
        await bench.ready()
        await bench.drive(0.4, 0.3)
        written = len(bench.frames)
        bench.command(0.31)
        await bench.until(lambda: len(bench.frames) > written)
        words = bench.operator.engage_estop("a test")
        assert not bench.stopped
        assert any(bench.latch.settle() for _ in range(40))
        asking = asyncio.create_task(bench.operator.acknowledged(words))
        await asyncio.sleep(0)
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)
        loop.freeze(2 * WITHIN_S)
        assert (await asking).success
        assert bench.stopped
        assert ("estop", True) in bench.reported
        (event,) = [each for each in bench.heard.events if each.kind == "estop"]
        assert event.message == words


@on_virtual_time
async def test_a_stop_whose_write_finds_the_port_gone_was_not_sent(tmp_path: Path) -> None:
    async with Watched(tmp_path, "streamed") as bench:
        await bench.ready()
        await bench.drive(0.5, 0.3)
        # As long as nothing else notices: a write is the first to.
        port = bench.port
        assert port is not None
        port.write = lambda _: port._memory.on_lost(OSError(errno.EIO, "gone"))  # type: ignore[method-assign]
        answer = await bench.operator.acknowledged(bench.operator.engage_estop("a test"))
        assert not answer.success
        assert "It could not be sent, because no board is connected: " in answer.message


@on_virtual_time
async def test_a_stop_without_a_board_is_answered_at_once_with_the_reason(tmp_path: Path) -> None:
    async with Watched(tmp_path, "streamed") as bench:
        await bench.ready()
        await bench.drive(0.5, 0.3)
        bench.robot.unplug(bench.clock.now_ns())
        await bench.until(lambda: bench.controller.state()[0] == "waiting")
        answer = await bench.operator.acknowledged(bench.operator.engage_estop("a test"))
        assert not answer.success
        assert "It could not be sent, because no board is connected: " in answer.message
        assert answer.data == {"sent": False, "stands": None, "fastest_m_s": None}
        assert bench.controller.state()[0] == "estopped"


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_a_fault_is_reported_after_the_bytes_of_its_cut(tmp_path: Path, dialect: str) -> None:
    async with Watched(tmp_path, dialect) as bench:
        await bench.ready()
        for phase_ms in (0, 5, 10):
            for dead in (False, True):
                faults = MotorFaults(encoder_dead=dead)
                bench.robot.set_faults("left", faults, now_ns=bench.clock.now_ns())
                await bench.drive(0.0 if dead else 0.5, 0.3)
            await asyncio.sleep(phase_ms / 1000)
            step = 0
            while bench.controller.state()[0] != "fault":
                bench.command(0.3 + (step := step + 1) / 2000)
                await asyncio.sleep(0.005)
                assert bench.stopped or bench.controller.state()[0] != "fault"
            await asyncio.sleep(1.1)
            assert bench.operator.release_estop()[0]
        faults_seen = [stopped for kind, stopped in bench.reported if kind == "no_counts"]
        assert faults_seen == [True] * 3


@on_virtual_time
async def test_what_waits_at_the_end_is_reported_then(tmp_path: Path) -> None:
    heard: list[str] = []
    reports = StopReports(LoopClock(), lambda: None)
    reports.announce(heard.append)
    assert reports.waiting
    assert heard == []
    reports.close()
    assert len(heard) == 1
    assert not reports.waiting


@on_virtual_time
async def test_a_report_waits_no_longer_than_it_may_and_each_is_made_once() -> None:
    heard: list[tuple[int, str]] = []
    outcome: list[str | None] = [None]
    clock = LoopClock()
    reports = StopReports(clock, lambda: outcome[0])
    reports.announce(lambda problem: heard.append((1, problem)))
    await asyncio.sleep(WITHIN_S / 2)
    reports.announce(lambda problem: heard.append((2, problem)))
    await asyncio.sleep(WITHIN_S / 2 + 0.01)
    assert [number for number, _ in heard] == [1]
    assert "has not taken it" in heard[0][1]
    outcome[0] = ""
    assert await reports.sent() == ""
    assert heard[1:] == [(2, "")]
    reports.close()
