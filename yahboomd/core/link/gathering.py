"""The number of bytes to wait for: a line in many pieces wakes the reader once.

A USB bridge hands over what it has every millisecond, so that a line of counts comes in three or
more pieces, and each of them costs the reader a turn of its event loop for nothing. The kernel can
wait for the rest: a terminal is not readable before ``VMIN`` bytes are there. On the simulated
board, which sends 260 lines a second in 700 pieces, this saves a fifth of the daemon's CPU.

Laws: counts that change wait for nothing but their own line. So whole lines are waited for only
while one is as long as the other; with the first that differs, every byte is heard as it comes. And
no byte waits for more than 20 ms while lines keep their pace: where the counts have not changed for
some time, several lines wake the reader once, until one of them differs or a command turns the
wheels. Where such lines become slow, or end, the first that waits does so until the poller looks,
54 ms at most. The answers of a board that is asked every 10 to 20 ms wake it not at all then: it
reads each before it asks again. A board that is asked more often may not have answered by then.
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

WANTED_NS: Final = 20_000_000
"""Readings are wanted so often, unless said otherwise."""

LONGEST: Final = 64
"""No line of counts is longer."""

MOST: Final = 255
"""The kernel waits for no more bytes."""

PAUSED_NS: Final = 20_000_000
"""Lines farther apart than this show that the stream paused: they are counted from 0 again."""

FETCHED_NS: Final = (10_000_000, 20_000_000)
"""The answers of a board are fetched where its questions are so far apart."""


class Gathering:
    """Finds the number of bytes from the lines that come.

    Args:
        line_end: Bytes behind a frame that belong to it.
        asked_ns: From question to question; None for a board that is not asked.
        wanted_ns: How often readings are wanted at least, as far as lines come so often.

    Attributes:
        least: Bytes to wait for.
        fetched: No line wakes the reader, which looks by itself before it asks again.
        lines: The lines that they are; 1 as well where fewer bytes than a line are waited for.
        apart_ns: From one line to the next, on the average; only where there are several.
    """

    def __init__(
        self, line_end: int, asked_ns: int | None = None, *, wanted_ns: int = WANTED_NS
    ) -> None:
        self._line_end = line_end
        self._wanted_ns = wanted_ns
        self._asked = asked_ns is not None
        self._fetches = asked_ns is not None and FETCHED_NS[0] <= asked_ns <= FETCHED_NS[1]
        self._size = 0
        self._alike = 0
        self._unchanged = 0
        self._since_ns = self._heard_ns = 0
        self.least = self.lines = 1
        self.apart_ns = LATER_NS + 1
        self.fetched = False

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
        if not self._asked and now_ns - self._heard_ns > PAUSED_NS:
            self._unchanged = 0
        self._heard_ns = now_ns
        if self._unchanged % UNCHANGED == 0:
            self.apart_ns = max(1, (now_ns - self._since_ns) // UNCHANGED)
            self._since_ns = now_ns

    def stir(self) -> None:
        """The wheels are to turn: the next line is not waited for with others."""
        # With that line the lines are counted from 0, and their pace is measured, again.
        self._unchanged = -1

    def adjust(self, held: int) -> bool:
        """After a read, when its lines are made use of.

        Args:
            held: Bytes of a line that is not whole yet.

        Returns:
            Whether :attr:`least` has changed, and the port must be set to it.
        """
        self.lines = 1
        self.fetched = False
        if held > self._line_end or self._alike < ALIKE or self._size > LONGEST:
            least = 1
        else:
            # From here to the same place in the next line, be it before its line end or behind.
            least = whole = self._size + self._line_end
            if self._unchanged >= UNCHANGED:
                if self._fetches:
                    self.fetched, least = True, MOST
                elif not self._asked:
                    often = max(1, self._wanted_ns // self.apart_ns)
                    self.lines = min(1 + LATER_NS // self.apart_ns, often, MOST // whole)
                    least = whole * self.lines
        if self.least == least:
            return False
        self.least, self._alike = least, 0 if least == 1 else self._alike
        return True
