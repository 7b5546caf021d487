"""The link on a real pty in real time: nothing here depends on how fast this machine is."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from pathlib import Path

import pytest
from board_bench import Recorder

from yahboomd.core.clock import SystemClock
from yahboomd.core.link.port import Port, PortOptions, open_port
from yahboomd.core.link.session import Session, SessionOptions
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.pty import PtyPort
from yahboomd.simulation.robot import SimulatedRobot

pytestmark = pytest.mark.realtime


class Connected:
    """A simulated robot behind a pty, and a session with it."""

    def __init__(self, folder: Path, simulation: SimulationOptions, options: SessionOptions):
        self.robot = SimulatedRobot(simulation)
        self.board = PtyPort(self.robot, link=folder / "board")
        self.clock = SystemClock()
        self.recorder = Recorder()
        self.session = Session(self._open, self.clock, self.recorder, options)
        self._path = str(folder / "board")

    async def _open(self) -> Port:
        return await open_port(PortOptions(path=self._path), self.clock)

    async def until(self, condition: Callable[[], object]) -> None:
        async with asyncio.timeout(60.0):
            while not condition():
                await asyncio.sleep(0.002)


@contextlib.asynccontextmanager
async def connected(
    folder: Path, simulation: SimulationOptions, options: SessionOptions
) -> AsyncIterator[Connected]:
    robot = Connected(folder, simulation, options)
    robot.board.open()
    running = asyncio.create_task(robot.session.run())
    try:
        await robot.until(lambda: robot.recorder.readings or running.done())
        yield robot
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        robot.board.close()


@pytest.mark.parametrize("pace", ["wire", pytest.param("measured", marks=pytest.mark.nightly)])
async def test_streamed_reads_every_frame_that_the_wire_carries(tmp_path: Path, pace: str) -> None:
    simulation = SimulationOptions(
        stream_pace=pace,  # type: ignore[arg-type]
        initial_ticks=(-1_234_567, 1_234_567, -9, 8_765_432),
    )
    options = SessionOptions(battery_period_s=0.0)
    async with connected(tmp_path, simulation, options) as robot:
        sent: list[bytes] = []
        emit = robot.robot.board.emit

        def count(data: bytes, now_ns: int) -> None:
            if data.startswith(b"$MAll"):
                sent.append(data)
            emit(data, now_ns)

        robot.robot.board.emit = count  # type: ignore[method-assign]
        dropped_before = -1
        # After a pause of this process the board sends more at once than a pty has room for.
        while dropped_before != robot.board.dropped_bytes:
            dropped_before = robot.board.dropped_bytes
            sent.clear()
            first = len(robot.recorder.readings)
            robot.recorder.board.drive((300, 0, 250, 0))
            await robot.until(lambda: len(sent) >= 400)
        robot.robot.board.emit = emit  # type: ignore[method-assign]
        commanded = [tuple(map(int, line[6 : line.index(b"#")].split(b","))) for line in sent]

        def all_heard() -> bool:
            # Some lines were on their way when the counting began: more, the busier the machine.
            heard = [each.ticks for each in robot.recorder.readings[first:]]
            return any(
                heard[start : start + len(commanded)] == commanded for start in range(len(heard))
            )

        await robot.until(all_heard)
        facts = robot.session.status_values()
        if dropped_before == 0:
            assert facts["bad_bytes"] + facts["discarded_bytes"] + facts["overlong"] == 0
