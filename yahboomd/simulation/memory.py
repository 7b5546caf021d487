"""A simulated robot in the same process, on the running loop's time: for tests.

On a virtual-time loop minutes of driving take moments, and every run is the same.
"""

from __future__ import annotations

import asyncio
import errno
import os
from collections.abc import Callable

from yahboomd.core.errors import PortBusy, PortMissing
from yahboomd.core.model import NS_PER_S
from yahboomd.simulation.robot import SimulatedRobot
from yahboomd.simulation.wire import transfer_ns


class MemoryPort:
    """The host's end of the line to a robot.

    The robot lives on when the port is closed, and may be opened again by another port.

    Attributes:
        on_data: Takes each chunk of bytes as it arrives.
        on_lost: Called once when the port is gone: with an OSError when the plug was pulled, with
            None after :meth:`close`.
    """

    def __init__(
        self,
        robot: SimulatedRobot,
        *,
        on_data: Callable[[bytes], None] = lambda _data: None,
        on_lost: Callable[[Exception | None], None] = lambda _why: None,
        name: str = "memory",
    ) -> None:
        self.robot = robot
        self.name = name
        self.byte_ns = transfer_ns(1, robot.options.baud)
        self.on_data = on_data
        self.on_lost = on_lost
        self._loop: asyncio.AbstractEventLoop | None = None
        self._timer: asyncio.TimerHandle | None = None

    def queued(self) -> int:
        """Bytes that are not sent yet: none, the wire takes all at once."""
        return 0

    @property
    def is_open(self) -> bool:
        """Whether bytes pass."""
        return self._loop is not None

    def open(self) -> None:
        """Start to carry bytes, on the running loop.

        Raises:
            PortMissing: The robot's plug is out.
            PortBusy: Another port has it.
        """
        if self._loop is not None or self.robot.on_plug is not None:
            raise PortBusy("The simulated robot's port is open already.")
        self._loop = asyncio.get_running_loop()
        now_ns = self._now_ns()
        if not self.robot.started:
            self.robot.start(now_ns)
        # Bytes sent while the port was closed are lost.
        self.robot.host_reads(now_ns)
        if not self.robot.plugged:
            self._loop = None
            raise PortMissing("The simulated robot is unplugged.")
        self.robot.on_plug = self._plug
        self._schedule()

    def listen(
        self, on_data: Callable[[bytes], None], on_lost: Callable[[Exception | None], None]
    ) -> None:
        """Set who receives bytes and the loss of the port."""
        self.on_data = on_data
        self.on_lost = on_lost

    def drop_input(self) -> None:
        """Do nothing: no byte is kept."""

    def discard(self) -> None:
        """Do nothing: no byte is queued."""

    async def drain(self, timeout_s: float) -> bool:
        """Wait until the wire has carried everything; whether it has."""
        if self._loop is None:
            return False
        left_s = self.robot.host_backlog_ns(self._now_ns()) / NS_PER_S
        await asyncio.sleep(min(left_s, timeout_s))
        return left_s <= timeout_s

    def write(self, data: bytes) -> None:
        """Send bytes; nothing happens on a port that is closed or lost."""
        if self._loop is None:
            return
        self.robot.host_wrote(data, self._now_ns())
        self._schedule()

    def poke(self) -> None:
        """Advance the robot again, after something was done to it from outside."""
        if self._loop is not None:
            self._wake()

    def close(self) -> None:
        """Stop carrying bytes; safe to call twice."""
        self._lose(None)

    def _now_ns(self) -> int:
        assert self._loop is not None
        return round(self._loop.time() * NS_PER_S)

    def _schedule(self) -> None:
        if self._loop is None:
            return
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self._loop.call_at(self.robot.next_ns / NS_PER_S, self._ring)

    def _ring(self) -> None:
        self._timer = None
        self._wake()

    def _wake(self) -> None:
        for chunk in self.robot.host_reads(self._now_ns()):
            # The reader of a chunk may close the port.
            if self._loop is None:
                return
            self.on_data(chunk)
        self._schedule()

    def _plug(self, plugged: bool) -> None:
        if not plugged:
            self._lose(OSError(errno.EIO, os.strerror(errno.EIO)))

    def _lose(self, why: Exception | None) -> None:
        loop, self._loop = self._loop, None
        if loop is None:
            return
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self.robot.on_plug = None
        loop.call_soon(self.on_lost, why)
