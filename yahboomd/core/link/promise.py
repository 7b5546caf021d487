"""A promise that its owner renews for the price of a store, in memory that the guard has mapped.

No name leads to the memory. A timerfd that the guard polls would save it two wake-ups a second, but
Python has one from 3.13 on only, and a renewal would be a call of the kernel in each control step.
"""

from __future__ import annotations

import mmap
import os

SIZE = 4096


class _Word(int):
    """The place of one of the numbers."""

    def __get__(self, promise: Promise, _class: type[Promise]) -> int:
        return promise.words[self]

    def __set__(self, promise: Promise, value: int) -> None:
        promise.words[self] = value


class Promise:
    """Numbers, each with one writer, so that none is ever seen half.

    Args:
        fd: The memory; from :func:`memory`.

    Attributes:
        until_ms: When it lapses, on the monotonic clock; 0 once the wheels were seen to stand.
        stop: The number of the guard's newest stop.
        acknowledged: The number of the stop after which the owner may command motion again.
        let_go: The motors are without power: a zero speed would start the board's loop.
        asked: The number of the newest stop that a program of this machine asked the guard for.
        obeyed: The number of the newest one for which the owner engaged its emergency stop.
        refused: Connections for stops that were refused.
        dropped: Those that ended without a request.
        heard_ms: When the board's newest counts came.
        read: The number of the newest message about the promise that the guard has read.
    """

    until_ms, stop, acknowledged, let_go = map(_Word, range(4))
    asked, obeyed, refused, dropped, heard_ms = map(_Word, range(4, 9))
    read = _Word(9)

    def __init__(self, fd: int) -> None:
        self.words = memoryview(mmap.mmap(fd, SIZE)).cast("q")


def memory() -> int:
    """The descriptor of new memory for one promise."""
    fd = os.memfd_create("yahboomd-promise")
    os.ftruncate(fd, SIZE)
    return fd
