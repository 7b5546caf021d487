"""The number of bytes to wait for: a line in many pieces wakes the reader once.

A USB bridge hands over what it has every millisecond, so that a line of counts comes in three or
more pieces, and each of them costs the reader a turn of its event loop for nothing. The kernel can
wait for the rest: a terminal is not readable before ``VMIN`` bytes are there. On the simulated
board, which sends 260 lines a second in 700 pieces, this saves a fifth of the daemon's CPU.

Laws: counts that change wait for nothing but their own line. So whole lines are waited for only
while one is as long as the other; with the first that differs, every byte is heard as it comes.
And no byte waits for more than 20 ms while lines come: where the counts have not changed for some
time, several lines wake the reader once, until one of them differs.
"""

from __future__ import annotations

from typing import Final

ALIKE: Final = 8
"""The lines of one length that must come before the next one is waited for."""

UNCHANGED: Final = 50
"""The lines that must say the same before several are waited for."""

LATER_NS: Final = 15_000_000
"""The end of the first of several lines comes at most so long before that of the last one; a line
itself takes up to 5 ms on its wire."""

LONGEST: Final = 64
"""No line of counts is longer."""

MOST: Final = 255
"""The kernel waits for no more bytes."""


class Gathering:
    """Finds the number of bytes from the lines that come.

    Args:
        line_end: Bytes behind a frame that belong to it.

    Attributes:
        least: Bytes to wait for.
        lines: The lines that they are; 1 as well where fewer bytes than a line are waited for.
        apart_ns: From one line to the next, on the average; only where there are several.
    """

    def __init__(self, line_end: int) -> None:
        self._line_end = line_end
        self._size = 0
        self._alike = 0
        self._unchanged = 0
        self._since_ns = 0
        self.least = self.lines = 1
        self.apart_ns = LATER_NS + 1

    def line(self, size: int, *, unchanged: bool, now_ns: int) -> None:
        """A line of counts came.

        Args:
            size: Its bytes, without its line end.
            unchanged: It says the same as the one before it.
            now_ns: When; monotonic nanoseconds.
        """
        self._alike = self._alike + 1 if size == self._size else 0
        self._size = size
        self._unchanged = self._unchanged + 1 if unchanged else 0
        if self._unchanged % UNCHANGED == 0:
            # Of the latest ones: before them the stream may have paused.
            self.apart_ns = max(1, (now_ns - self._since_ns) // UNCHANGED)
            self._since_ns = now_ns

    def adjust(self, held: int) -> bool:
        """After a read, when its lines are made use of.

        Args:
            held: Bytes of a line that is not whole yet.

        Returns:
            Whether :attr:`least` has changed, and the port must be set to it.
        """
        self.lines = 1
        if held > self._line_end or self._alike < ALIKE or self._size > LONGEST:
            return self._wait_for(1)
        # From here to the same place in the next line, be it before its line end or behind.
        whole = self._size + self._line_end
        if self._unchanged >= UNCHANGED:
            self.lines = min(1 + LATER_NS // self.apart_ns, MOST // whole)
        return self._wait_for(whole * self.lines)

    def _wait_for(self, least: int) -> bool:
        if self.least == least:
            return False
        self.least, self._alike = least, 0 if least == 1 else self._alike
        return True
