"""The age of a line's counts, where the board reads and reports them by different timers.

Law: both timers run by one clock. So with each line the age of its counts grows by what is left of
the line's period behind whole periods of the other timer, and starts again where it would exceed
one. Only the age of the first line is not known. Of all that are possible the one is right with
which the speed of a wheel changes the steadiest.

The moments of the lines follow their arrivals slowly, since these are late by more or less.
"""

from __future__ import annotations

import math

STEP_NS = 1_000_000
"""Timers count whole milliseconds."""

FAST_TICKS = 12
"""Lines with fewer counts say nothing of their age."""

WEIGHT = 1.0 / 30.0
"""The weight of the latest line in the unsteadiness of the speed."""

ENOUGH = 24
"""So many fast lines before an age is believed."""

CLEARLY = 3.0
"""The second best age is at least so much worse."""

FOLLOW = 0.1
"""The time by which the moment of a line follows its arrival."""


class LineAge:
    """The lines of one board.

    Args:
        line_ns: From line to line.
        tick_ns: From reading to reading of the encoders.

    Attributes:
        age_ns: Of the latest line's counts; None where it is not known.
        step_ns: From the sampling of the line before to that of the latest one; None likewise.
        moment: When the latest line left, in the time of the arrivals.
    """

    __slots__ = (
        "_line_ns _tick_ns _first _ages _paces _changes _errors _seen age_ns step_ns moment"
    ).split()

    def __init__(self, line_ns: int, tick_ns: int) -> None:
        self._line_ns = line_ns
        self._tick_ns = tick_ns
        self._first = tuple(range(0, tick_ns, STEP_NS))
        self.forget()

    def forget(self) -> None:
        """The next line does not continue those before."""
        self._ages = list(self._first)
        self._paces = [0.0] * len(self._ages)
        self._changes = [math.nan] * len(self._ages)
        self._errors = [0.0] * len(self._ages)
        self._seen = 0
        self.age_ns: int | None = None
        self.step_ns: int | None = None
        self.moment: float | None = None

    def add(self, arrival: float, moved: int) -> None:
        """Take in a line.

        Args:
            arrival: When it left the board, as far as its arrival tells.
            moved: Counts of the busiest wheel since the line before.
        """
        if self.moment is None:
            self.moment = arrival
            return
        lines = max(1, round((arrival - self.moment) / self._line_ns))
        self.moment += lines * self._line_ns
        self.moment += FOLLOW * (arrival - self.moment)
        fast = moved >= FAST_TICKS * lines
        known = self.age_ns is not None
        steps = [self._step(index, lines, moved if fast else 0) for index in range(len(self._ages))]
        self._seen += fast
        best, second = sorted(range(len(steps)), key=self._errors.__getitem__)[:2]
        if self._seen < ENOUGH or self._errors[second] <= CLEARLY * self._errors[best]:
            self.age_ns = self.step_ns = None
            return
        self.age_ns = self._ages[best]
        self.step_ns = steps[best] if known else None

    def _step(self, index: int, lines: int, moved: int) -> int:
        """Go on with one of the ages; return the time from sampling to sampling that it means."""
        before, pace = self._ages[index], self._paces[index]
        after = (before + lines * self._line_ns) % self._tick_ns
        step_ns = lines * self._line_ns - after + before
        self._ages[index] = after
        self._paces[index] = now = moved / step_ns
        change = pace / now if now and pace else math.nan
        if not math.isnan(bend := change - self._changes[index]):
            self._errors[index] += WEIGHT * (bend * bend - self._errors[index])
        self._changes[index] = change
        return step_ns
