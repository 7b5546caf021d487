"""The age of a line's counts, if the board reads and reports them by different timers.

Law: both timers run by one clock. So from line to line the age of the counts grows by the line's
period, modulo the period of the other timer. Only the age of the first line is unknown. The right
one of all possible ages makes the speed of a wheel change most steadily.

The moments of the lines follow their arrivals slowly, because delays vary.
"""

from __future__ import annotations

import math

STEP_NS = 1_000_000
"""Timers count whole milliseconds."""

FAST_TICKS = 12
"""Lines with fewer counts do not show their age."""

WEIGHT = 1.0 / 30.0
"""The weight of the latest line in the unsteadiness of the speed."""

ENOUGH = 24
"""The fast lines that are needed before an age is believed."""

CLEARLY = 3.0
"""The second best age must be at least this many times worse."""

FOLLOW = 0.1
"""The share of its delay by which the moment of a line follows its arrival."""


class LineAge:
    """Estimates the age of the counts in each line of a board.

    Args:
        line_ns: The time from line to line.
        tick_ns: The time from reading to reading of the encoders.

    Attributes:
        age_ns: Age of the latest line's counts; None if unknown.
        step_ns: Time from the sampling of the line before to that of the latest; None if unknown.
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
        """Start again: the next line does not continue those before."""
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
            arrival: When it left the board, as its arrival shows.
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
        """Advance one of the ages; return the time from sampling to sampling that it implies."""
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
