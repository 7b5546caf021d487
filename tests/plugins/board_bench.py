"""A simulated board behind the session's port, on virtual time."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, Self

from yahboomd.core.link.connected_board import ConnectedBoard
from yahboomd.core.link.handshake import Identity
from yahboomd.core.link.port import byte_time_ns
from yahboomd.core.link.session import Session, SessionOptions
from yahboomd.core.model import Counts, EncoderReading, Event, ImuReading
from yahboomd.simulation.memory import MemoryPort
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.robot import SimulatedRobot
from yahboomd.simulation.virtual_time import LoopClock


class BoardPort:
    """The simulated board's line as a session's port; it keeps the written bytes."""

    name = "/dev/simulated"
    byte_ns = byte_time_ns(115200)
    waiting = 0

    def __init__(self, robot: SimulatedRobot) -> None:
        self._memory = MemoryPort(robot)
        self._memory.open()
        self._clock = LoopClock()
        self.written: list[tuple[int, bytes]] = []
        self.closed = False

    def listen(self, on_data: Any, on_lost: Any) -> None:
        self._memory.listen(on_data, on_lost)

    def queued(self) -> int:
        return self.waiting

    def write(self, data: bytes) -> None:
        self.written.append((self._clock.now_ns(), data))
        self._memory.write(data)

    def drop_input(self) -> None:
        """Nothing is kept."""

    def discard(self) -> None:
        """Nothing waits."""

    async def drain(self, timeout_s: float) -> bool:
        await asyncio.sleep(0.005)
        return self._memory.is_open

    def close(self) -> None:
        self.closed = True
        self._on_data = lambda _: None
        self._memory.on_data = lambda _: None
        self._memory.on_lost = lambda _: None
        self._memory.close()

    @property
    def frames(self) -> list[bytes]:
        return [data.strip(b"\n") for _, data in self.written]


class Recorder:
    """Records the session's calls."""

    def __init__(self) -> None:
        self.board: ConnectedBoard | None = None
        self.identities: list[Identity] = []
        self.readings: list[EncoderReading] = []
        self.imu_readings: list[ImuReading] = []
        self.volts: list[float] = []
        self.resets: list[str] = []
        self.events: list[Event] = []
        self.sent_units: list[Counts | None] = []

    def connected(self, board: ConnectedBoard, identity: Identity) -> None:
        self.board = board
        self.identities.append(identity)

    def armed(self) -> None:
        pass

    def reading(self, reading: EncoderReading) -> None:
        self.readings.append(reading)

    def imu(self, reading: ImuReading) -> None:
        self.imu_readings.append(reading)

    def battery(self, volts: float) -> None:
        self.volts.append(volts)

    def board_reset(self, version: str) -> None:
        self.resets.append(version)

    def event(self, event: Event) -> None:
        self.events.append(event)

    def sent(self, units: Counts | None) -> None:
        self.sent_units.append(units)

    def leaving(self) -> None:
        pass


class Bench:
    """A robot, a session with it, and the bytes of both."""

    def __init__(
        self, simulation: SimulationOptions | None = None, options: SessionOptions | None = None
    ) -> None:
        self.robot = SimulatedRobot(simulation or SimulationOptions())
        self.recorder = Recorder()
        self.options = options or SessionOptions()
        self.port: BoardPort | None = None
        self.session = Session(self.open, LoopClock(), self.recorder, self.options)
        self.task: asyncio.Task[None] | None = None

    async def open(self) -> BoardPort:
        self.port = BoardPort(self.robot)
        return self.port

    async def __aenter__(self) -> Self:
        self.task = asyncio.create_task(self.session.run())
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.stop()

    async def stop(self) -> None:
        assert self.task is not None
        self.task.cancel()
        await asyncio.gather(self.task, return_exceptions=True)

    async def ended(self) -> None:
        """Wait until the session ends, and raise what ended it."""
        assert self.task is not None
        await self.task

    async def connected(self) -> None:
        await self.until(lambda: self.recorder.readings)

    async def until(self, condition: Callable[[], object], within_s: float = 10.0) -> None:
        """Wait, in virtual time, until a condition holds or the session ended."""
        assert self.task is not None
        async with asyncio.timeout(within_s):
            while not condition():
                if self.task.done():
                    self.task.result()
                await asyncio.sleep(0.001)

    def now_ns(self) -> int:
        return LoopClock().now_ns()

    @property
    def wheels(self) -> ConnectedBoard:
        """The receiver of commands."""
        assert self.recorder.board is not None
        return self.recorder.board

    @property
    def rim_speeds(self) -> list[float]:
        """The true speeds of the wheels."""
        return [motor.speed_m_s for motor in self.robot.plant.motors]


class LinkBench:
    """A simulated robot behind a port that is opened and closed again, on virtual time.

    Attributes:
        on_open: Called at each opening, with the number of earlier openings.
        on_write: May change the host's bytes (None loses them).
    """

    def __init__(self, **options: Any) -> None:
        self.robot = SimulatedRobot(SimulationOptions(**options))
        self.clock = LoopClock()
        self.ports: list[BoardPort] = []
        self.on_open: Callable[[int], None] = lambda _times: None
        self.on_write: Callable[[bytes], bytes | None] = lambda data: data

    async def open(self) -> BoardPort:
        if not self.robot.started:
            self.robot.start(self.clock.now_ns())
        self.on_open(len(self.ports))
        self.ports.append(_TappedPort(self))
        return self.ports[-1]

    async def drive(self, units: int = 300, for_s: float = 0.5) -> None:
        """Turn the wheels, as a daemon that is then killed: no stop is sent."""
        port = await self.open()
        for frame in (b"$mtype:1#", b"$spd:%d,0,%d,0#" % (units, units)):
            port.write(frame)
            port.write(frame.replace(b"spd", b"speed"))
            await asyncio.sleep(0.03)
        port.write(b"$upload:1,0,0#")
        await asyncio.sleep(for_s)
        port.close()

    @property
    def now_ns(self) -> int:
        return self.clock.now_ns()

    @property
    def frames(self) -> list[bytes]:
        """The bytes that were written to the port that was opened last."""
        return [frame for frame in self.ports[-1].frames if frame]

    @property
    def rim_speeds(self) -> list[float]:
        """The true speeds of the wheels, now."""
        self.robot.advance(self.now_ns)
        return [motor.speed_m_s for motor in self.robot.plant.motors]


class _TappedPort(BoardPort):
    def __init__(self, bench: LinkBench) -> None:
        super().__init__(bench.robot)
        self._bench = bench

    def write(self, data: bytes) -> None:
        passed = self._bench.on_write(data)
        if passed is not None:
            super().write(passed)
