"""A promise that its owner renews for the price of a store, in memory that the guard has mapped.

No name leads to the memory. A timerfd that the guard polls would save it two wake-ups a second, but
Python has one from 3.13 on only, and a renewal would be a call of the kernel in each control step.
"""

from __future__ import annotations

import mmap
import os

SIZE = 4096

_UNTIL_MS, _STOP, _ACKNOWLEDGED, _LET_GO, _ASKED, _OBEYED, _REFUSED, _DROPPED = range(8)


class Promise:
    """Numbers, each with one writer, so that none is ever seen half.

    Args:
        fd: The memory; from :func:`memory`.
    """

    def __init__(self, fd: int) -> None:
        self._words = memoryview(mmap.mmap(fd, SIZE)).cast("q")

    @property
    def until_ms(self) -> int:
        """When it lapses, on the monotonic clock; 0 once the wheels were seen to stand."""
        return self._words[_UNTIL_MS]

    @until_ms.setter
    def until_ms(self, value: int) -> None:
        self._words[_UNTIL_MS] = value

    @property
    def let_go(self) -> bool:
        """Whether the motors are without power: a zero speed would start the board's loop."""
        return self._words[_LET_GO] != 0

    @let_go.setter
    def let_go(self, value: bool) -> None:
        self._words[_LET_GO] = value

    @property
    def stop(self) -> int:
        """The number of the guard's newest stop."""
        return self._words[_STOP]

    @stop.setter
    def stop(self, value: int) -> None:
        self._words[_STOP] = value

    @property
    def acknowledged(self) -> int:
        """The number of the stop after which the owner may command motion again."""
        return self._words[_ACKNOWLEDGED]

    @acknowledged.setter
    def acknowledged(self, value: int) -> None:
        self._words[_ACKNOWLEDGED] = value

    @property
    def asked(self) -> int:
        """The number of the newest stop that a program of this machine asked the guard for."""
        return self._words[_ASKED]

    @asked.setter
    def asked(self, value: int) -> None:
        self._words[_ASKED] = value

    @property
    def obeyed(self) -> int:
        """The number of the newest one for which the owner engaged its emergency stop."""
        return self._words[_OBEYED]

    @obeyed.setter
    def obeyed(self, value: int) -> None:
        self._words[_OBEYED] = value

    @property
    def turned_away(self) -> tuple[int, int]:
        """Connections for stops that were refused, and that ended without a request."""
        return self._words[_REFUSED], self._words[_DROPPED]

    @turned_away.setter
    def turned_away(self, value: tuple[int, int]) -> None:
        self._words[_REFUSED], self._words[_DROPPED] = value


def memory() -> int:
    """The descriptor of new memory for one promise."""
    fd = os.memfd_create("yahboomd-promise")
    os.ftruncate(fd, SIZE)
    return fd
