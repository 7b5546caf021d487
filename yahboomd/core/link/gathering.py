"""The number of bytes to wait for, so that a line in many pieces wakes the reader once.

A USB bridge hands over its bytes every millisecond, so that a line of counts comes in three or more
pieces. The kernel can wait for the rest: a terminal is not readable before ``VMIN`` bytes are
there. Lines that are alike are waited for as a whole; from the first that differs on, every byte is
heard as it comes.
"""

from __future__ import annotations

from typing import Final

ALIKE: Final = 8
"""The lines of one length that must come before the next one is waited for."""

LONGEST: Final = 64
"""No line of counts is longer."""


class Gathering:
    """Finds the number of bytes from the lines that come.

    Args:
        line_end: Bytes behind a frame that belong to it.

    Attributes:
        least: Bytes to wait for.
    """

    def __init__(self, line_end: int) -> None:
        self._line_end = line_end
        self._size = 0
        self._alike = 0
        self.least = 1

    def line(self, size: int) -> None:
        """Count a line of counts of this many bytes, its line end left aside."""
        self._alike = self._alike + 1 if size == self._size else 0
        self._size = size

    def adjust(self, held: int) -> bool:
        """Adjust :attr:`least` after a read, when its lines are made use of.

        Args:
            held: Bytes of a line that is not whole yet.

        Returns:
            Whether :attr:`least` has changed, and the port must be set to it.
        """
        whole = held <= self._line_end and self._alike >= ALIKE and self._size <= LONGEST
        # From here to the same place in the next line, be it before its line end or behind.
        least = self._size + self._line_end if whole else 1
        if self.least == least:
            return False
        self.least, self._alike = least, 0 if least == 1 else self._alike
        return True
