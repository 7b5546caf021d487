"""The number of bytes to wait for: a line in many pieces wakes the reader once.

A USB bridge hands over what it has every millisecond, so that a line of counts comes in three or
more pieces, and each of them costs the reader a turn of its event loop for nothing. The kernel can
wait for the rest: a terminal is not readable before ``VMIN`` bytes are there. On the simulated
board, which sends 260 lines a second in 700 pieces, this saves a fifth of the daemon's CPU.

Law: counts wait for nothing but their own line. So whole lines are waited for only while one is
like the other; with the first that differs, every byte is heard as it comes.
"""

from __future__ import annotations

from typing import Final

ALIKE: Final = 8
"""The lines of one length that must come before the next one is waited for."""

LONGEST: Final = 64
"""No line of counts is longer. (The kernel's own limit is 255.)"""


class Gathering:
    """Finds the number of bytes from the sizes of the lines.

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

    def line(self, size: int, trailing: int) -> bool:
        """A line of counts is whole.

        Args:
            size: Its bytes, without its line end.
            trailing: Bytes that came with it, behind it.

        Returns:
            Whether :attr:`least` has changed, and the port must be set to it.
        """
        at_end = trailing <= self._line_end
        if size != self._size:
            self._size, self._alike = size, 0
        elif at_end:
            self._alike += 1
        if at_end and self._alike >= ALIKE and size <= LONGEST:
            # From here to the same place in the next line, be it before its line end or behind.
            return self._wait_for(size + self._line_end)
        return self._wait_for(1)

    def rest(self, held: int) -> bool:
        """Note the bytes of a line that is not whole yet; returns the same as :meth:`line`."""
        return held > self._line_end and self._wait_for(1)

    def _wait_for(self, least: int) -> bool:
        if self.least == least:
            return False
        self.least, self._alike = least, 0 if least == 1 else self._alike
        return True
