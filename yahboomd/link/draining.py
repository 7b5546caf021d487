"""Waiting until what was written has left the machine, without blocking the loop.

``tcdrain`` would block it, for ever where nobody takes the output.
"""

from __future__ import annotations

import fcntl
import struct
import termios
from collections.abc import Callable

from yahboomd.clock import Clock, nanoseconds, sleep_until


def in_kernel(fd: int) -> int:
    """Bytes that the system has taken and not sent yet; 0 for a descriptor that is gone."""
    try:
        answer = fcntl.ioctl(fd, termios.TIOCOUTQ, b"\0\0\0\0")
    except OSError:
        return 0
    return int(struct.unpack("i", answer)[0])


async def drained(
    clock: Clock, waiting: Callable[[], int | None], *, byte_ns: int, timeout_s: float
) -> bool:
    """Wait until nothing waits.

    Args:
        clock: What tells the time.
        waiting: How many bytes wait; None for a port that is lost.
        byte_ns: How long one takes.
        timeout_s: The longest wait.

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
