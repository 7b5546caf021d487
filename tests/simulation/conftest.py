"""A simulated robot on time that a test moves by hand."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import pytest

from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.robot import SimulatedRobot

RESYNC = b"\n" * 64


class Bench:
    """A host that writes, waits, and keeps the bytes that it read."""

    def __init__(self, **options: Any) -> None:
        self.robot = SimulatedRobot(SimulationOptions(**options))
        self.now_ns = 1_000_000_000
        self.robot.start(self.now_ns)
        self.chunks: list[tuple[int, bytes]] = []

    def run(self, seconds: float) -> bytes:
        """Let time pass; return what arrived meanwhile."""
        end_ns = self.now_ns + round(seconds * 1e9)
        before = len(self.chunks)
        while self.now_ns < end_ns:
            self.now_ns = min(end_ns, max(self.now_ns, self.robot.next_ns))
            self.chunks += [(self.now_ns, chunk) for chunk in self.robot.host_reads(self.now_ns)]
        return b"".join(chunk for _, chunk in self.chunks[before:])

    def send(self, data: bytes, wait_s: float = 0.03) -> bytes:
        """Write, let time pass, and return what arrived meanwhile."""
        self.robot.host_wrote(data, self.now_ns)
        return self.run(wait_s)

    def speeds(self) -> list[float]:
        """True rim speeds, m/s."""
        return [motor.speed_m_s for motor in self.robot.plant.motors]

    def totals(self) -> list[tuple[int, ...]]:
        """Every total line that has arrived whole."""
        text = b"".join(chunk for _, chunk in self.chunks).decode()
        lines = re.findall(r"\$MAll:(-?\d+),(-?\d+),(-?\d+),(-?\d+)#\r\n", text)
        return [tuple(map(int, line)) for line in lines]


@pytest.fixture
def bench() -> Callable[..., Bench]:
    """Makes a robot from options, with a host on it."""
    return Bench
