"""Records counts of the simulated robot, through the real link, on virtual time."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from typing import NamedTuple

from benchmarks.paths import RADIUS_M, TRACK_M
from yahboomd.core.link.connected_board import ConnectedBoard
from yahboomd.core.link.handshake import Identity
from yahboomd.core.link.session import Session, SessionOptions
from yahboomd.core.model import Counts, EncoderReading, Event, ImuReading, Pose2d
from yahboomd.simulation import virtual_time
from yahboomd.simulation.memory import MemoryPort
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.robot import SimulatedRobot
from yahboomd.simulation.virtual_time import LoopClock

COMMAND_HZ = 50

Drive = tuple[float, Callable[[float], tuple[float, float]]]
"""Seconds, and (m/s, rad/s) over seconds."""


def _square(t: float) -> tuple[float, float]:
    return (0.5, 0.0) if t % 3.0 < 2.0 else (0.0, math.pi / 2.0)


DRIVES: dict[str, Drive] = {
    "straight": (8.0, lambda _: (0.5, 0.0)),
    "circle": (13.0, lambda _: (0.5, 1.0)),
    "square": (12.0, _square),
    "figure of eight": (20.0, lambda t: (0.5, 1.5 * math.cos(2.0 * math.pi * t / 10.0))),
    "random": (
        20.0,
        lambda t: (0.3 + 0.2 * math.sin(0.9 * t), 1.5 * math.sin(1.3 * t) + math.cos(0.4 * t)),
    ),
}


class Record(NamedTuple):
    """The record of a drive.

    Attributes:
        readings: The counters that the link read.
        end: The true pose at the end.
        length_m: The length of its path.
    """

    readings: list[EncoderReading]
    end: Pose2d
    length_m: float


class _Ears:
    """Keeps readings."""

    def __init__(self) -> None:
        self.readings: list[EncoderReading] = []
        self.board: ConnectedBoard
        self.there = asyncio.Event()

    def connected(self, board: ConnectedBoard, _identity: Identity) -> None:
        self.board = board
        self.there.set()

    def armed(self) -> None: ...

    def reading(self, reading: EncoderReading) -> None:
        self.readings.append(reading)

    def imu(self, _reading: ImuReading) -> None: ...

    def battery(self, _volts: float) -> None: ...

    def board_reset(self, _version: str) -> None: ...

    def event(self, _event: Event) -> None: ...

    def sent(self, units: Counts | None) -> None: ...

    def leaving(self) -> None: ...


def record(drive: Drive, *, dialect: str, poll_rate_hz: float) -> Record:
    """Drive the simulated robot."""
    return virtual_time.run(_record(drive, dialect, poll_rate_hz))


async def _record(drive: Drive, dialect: str, poll_rate_hz: float) -> Record:
    seconds, twist = drive
    options = SimulationOptions(
        dialect=dialect, wheel_radius_m=RADIUS_M, wheel_separation_m=TRACK_M
    )
    robot = SimulatedRobot(options)
    ears, clock = _Ears(), LoopClock()

    async def opened() -> MemoryPort:
        port = MemoryPort(robot)
        port.open()
        return port

    session = Session(opened, clock, ears, SessionOptions(poll_rate_hz=poll_rate_hz))
    task = asyncio.create_task(session.run())
    await ears.there.wait()
    await asyncio.sleep(0.2)
    start = robot.truth(clock.now_ns())
    for n in range(round(seconds * COMMAND_HZ)):
        v, w = twist(n / COMMAND_HZ)
        left, right = (round(1000.0 * (v + side * w * TRACK_M / 2.0)) for side in (-1, 1))
        ears.board.drive((left, 0, right, 0))
        await asyncio.sleep(1.0 / COMMAND_HZ)
    ears.board.drive((0, 0, 0, 0))
    await asyncio.sleep(1.5)
    end = robot.truth(clock.now_ns())
    await asyncio.sleep(2.5 / poll_rate_hz)
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    # Relative to the pose at the start.
    cos, sin = math.cos(start.theta), math.sin(start.theta)
    dx, dy = end.x - start.x, end.y - start.y
    there = Pose2d(x=cos * dx + sin * dy, y=cos * dy - sin * dx, theta=end.theta - start.theta)
    length_m = (sum(end.travel_m) - sum(start.travel_m)) / 2.0
    return Record(ears.readings, there, length_m)
