"""A simulated board behind a serial driver that queues output, sends it slowly, or not at all."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

from board_bench import BoardPort
from fault_bench import FaultBench

from yahboomd.core.errors import PortMissing
from yahboomd.simulation.robot import SimulatedRobot

FULL = 11520.0
"""Bytes per second, all of a line at 115200 baud: the wire itself is modelled behind it."""


class QueueingPort(BoardPort):
    """A queue of the system: written bytes wait until the adapter takes them, one by one.

    Attributes:
        line: How the adapter fares, for every port that is opened on it.
    """

    def __init__(self, robot: SimulatedRobot, line: Line) -> None:
        super().__init__(robot)
        self.line = line
        self._queue = bytearray()
        self._sending = False
        line.ports.append(self)

    def queued(self) -> int:
        return len(self._queue) if self.line.tells else 0

    def write(self, data: bytes) -> None:
        if self.closed:
            return
        self.written.append((self._clock.now_ns(), data))
        self._queue += data
        if not self._sending:
            self._send()

    def _send(self) -> None:
        """Hand over the byte whose time has come."""
        self._sending = bool(self._queue) and not self.line.stalled and not self.closed
        if self._sending and self.line.bytes_per_s >= FULL:
            self._sending = False
            self.line.sent.append((self._clock.now_ns(), bytes(self._queue)))
            self._memory.write(bytes(self._queue))
            self._queue.clear()
        elif self._sending:
            self._memory.write(bytes([self._queue.pop(0)]))
            asyncio.get_running_loop().call_later(1.0 / self.line.bytes_per_s, self._send)

    def interrupted(self, frame: bytes, sent: int) -> None:
        """A frame with this number of bytes on the wire, while the rest waits."""
        self._memory.write(frame[:sent])
        self._queue += frame[sent:]

    def resume(self) -> None:
        """The adapter takes bytes again."""
        if not self._sending:
            self._send()

    def discard(self) -> None:
        if self.line.drops:
            self._queue.clear()

    async def drain(self, timeout_s: float) -> bool:
        loop = asyncio.get_running_loop()
        deadline = loop.time() + timeout_s
        while self._queue and loop.time() < deadline:
            await asyncio.sleep(0.001)
        return not self._queue

    def close(self) -> None:
        self._queue.clear()
        super().close()


class Line:
    """The adapter.

    Attributes:
        bytes_per_s: How fast it takes bytes.
        stalled: It takes none.
        drops: Its driver discards its queue when asked to (a UART's does, a USB adapter's not).
        tells: Its driver tells how much waits (a pseudo-terminal's does not).
        sent: What left at full speed, and when.
    """

    def __init__(self, *, drops: bool = False, tells: bool = True) -> None:
        self.bytes_per_s = FULL
        self.stalled = False
        self.drops = drops
        self.tells = tells
        self.sent: list[tuple[int, bytes]] = []
        self.ports: list[QueueingPort] = []

    def stall(self, for_s: float) -> None:
        """Take nothing for a while."""
        self.stalled = True
        asyncio.get_running_loop().call_later(for_s, self._resume)

    def _resume(self) -> None:
        self.stalled = False
        for port in self.ports:
            port.resume()


class QueueingBench(FaultBench):
    """A daemon without its bus, on such a line."""

    def __init__(self, folder: Path, line: Line, **arguments: Any) -> None:
        super().__init__(folder, **arguments)
        self.line = line

    async def _open(self) -> BoardPort:
        if self.robot.started:
            self.robot.advance(self.clock.now_ns())
        if not self.robot.plugged:
            raise PortMissing("/dev/simulated: there is no such port.")
        self.port = QueueingPort(self.robot, self.line)
        self.ports.append(self.port)
        return self.port
