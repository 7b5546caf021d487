"""Output that has not left the machine: its size, and waiting for it.

``tcdrain`` would block the loop, for ever if nothing takes the output. A pseudo-terminal does not
report its queue (0 always), and the drivers of USB adapters cannot drop theirs: their queue
goes out sooner or later, so no more than one frame is ever queued.
"""

from __future__ import annotations

import contextlib
import fcntl
import struct
import termios
from collections.abc import Callable

from yahboomd.core.clock import PAUSE_NS, Clock, nanoseconds, sleep_until
from yahboomd.core.model import NS_PER_S

STUCK_NS = 300_000_000
"""A port that sent nothing for this time sends nothing any more: only opening it again helps."""

SLOW_NS = 50_000_000
"""A frame that left this much later than its length explains left a slow port."""


def in_kernel(fd: int) -> int:
    """Bytes that the system has taken and not sent yet; 0 for a descriptor that is gone."""
    try:
        answer = fcntl.ioctl(fd, termios.TIOCOUTQ, b"\0\0\0\0")
    except OSError:
        return 0
    return int(struct.unpack("i", answer)[0])


def drop(fd: int) -> None:
    """Discard bytes that the system has taken and not sent yet, if the driver can."""
    with contextlib.suppress(OSError, termios.error):
        termios.tcflush(fd, termios.TCOFLUSH)


class OutputWatch:
    """Measures whether a port has sent its last frame, and how fast it sends.

    Args:
        queued: Returns the number of bytes that wait.
        byte_ns: The time of one byte on the wire.
    """

    def __init__(self, queued: Callable[[], int], byte_ns: int) -> None:
        self._queued = queued
        self._byte_ns = byte_ns
        self._size = 0
        self._written_ns = 0
        self._least: int | None = None
        self._moved_ns = 0
        self._looked_ns = 0
        self.slow_bytes_per_s: float | None = None

    def wrote(self, size: int, now_ns: int) -> None:
        """Note a frame that was written while nothing waited."""
        self._size, self._written_ns = size, now_ns

    def holds(self, now_ns: int) -> bool:
        left = self._queued()
        # A time in which this process did not run is no evidence about the port.
        paused = self._least is not None and now_ns - self._looked_ns >= PAUSE_NS
        self._looked_ns = now_ns
        if left == 0:
            if self._least is not None:
                self._least = None
                took_ns = now_ns - self._written_ns
                if not paused and took_ns - self._size * self._byte_ns >= SLOW_NS:
                    self.slow_bytes_per_s = self._size * NS_PER_S / took_ns
            return False
        if paused or self._least is None or left < self._least:
            self._least, self._moved_ns = left, now_ns
        return True

    def stuck(self, now_ns: int) -> bool:
        """Whether the port has sent none of the waiting bytes for :data:`STUCK_NS`."""
        return self._least is not None and now_ns - self._moved_ns >= STUCK_NS


async def drained(
    clock: Clock, waiting: Callable[[], int | None], *, byte_ns: int, timeout_s: float
) -> bool:
    """Wait until no bytes are queued.

    Args:
        waiting: Returns the number of queued bytes; None for a port that is lost.

    Returns:
        Whether everything is on the wire.
    """
    deadline_ns = clock.now_ns() + nanoseconds(timeout_s)
    while (left := waiting()) is not None:
        if left == 0:
            return True
        now_ns = clock.now_ns()
        if now_ns >= deadline_ns:
            return False
        await sleep_until(clock, min(deadline_ns, now_ns + left * byte_ns))
    return False
