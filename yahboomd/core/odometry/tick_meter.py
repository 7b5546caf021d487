"""The period at which a board renews its totals, from the lines that show it.

Law: a period is believed if the changes of the totals lie on a straight line over their number, as
straight as the distance of the lines allows, with a slope of whole milliseconds.

Only fast motion is measured, in which each renewal changes the totals. A renewal that no line shows
makes the next change twice as large, which numbers it. If every line brings a change of the same
size, no tick can be seen: the board renews its totals with each line.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple, TypeAlias

MS = 1e6

FAST_TICKS = 3
"""At this many counts a tick, a tick without any is impossible."""

WARM_UP = 8
"""The changes that show the pace; they are not numbered."""

ENOUGH_TICKS = 24
ENOUGH_NS = 400 * MS

PAUSE_NS = 100 * MS
"""Totals that stay for this time belong to standing wheels."""

MARKS_SHARE = 0.025
"""The least share of lines that repeat the totals or skip a tick, if there is a tick."""


AGREE_PERIODS = 2
AGREE_AGAIN = 4
MISFITS = 3
"""The measurements in a row that prove another period, a period after none fitted, and that none
fits."""

Notice: TypeAlias = Literal["period", "unfit"]


class Measured(NamedTuple):
    """The measurement of one stretch of fast motion.

    Attributes:
        period: Period of the changes, in nanoseconds.
        regular: Whether a timer of whole milliseconds makes them.
        marked: Whether lines repeated the totals or skipped a tick: without, lines and ticks
            cannot be distinguished.
    """

    period: float
    regular: bool
    marked: bool


class TickMeter:
    """Measures the period of the totals, one stretch of fast motion after the other.

    Attributes:
        spacing: The longest time between two changes of fast motion, by the number of lines in
            between; forgotten slowly.
    """

    __slots__ = (
        "spacing _changed _quiet _pace _warm _lines _marks _points _single _number _sums _origin"
    ).split()

    def __init__(self) -> None:
        self.spacing = 0.0
        self._changed: float | None = None
        self._quiet = 0
        self._pace = 0.0
        self._begin()

    def _begin(self) -> None:
        self._warm = 0
        self._lines = self._marks = self._points = self._single = self._number = 0
        self._sums = (0.0, 0.0, 0.0, 0.0, 0.0)

    def add(self, arrival: float, counts: int, gap: float, spread: float) -> Measured | None:
        """Take in a line.

        Args:
            arrival: When it came, or left; nanoseconds.
            counts: The largest change of any counter since the line before.
            gap: The mean time from line to line.
            spread: How unevenly lines come: their distance, and their delays.

        Returns:
            The measurement, when a stretch is complete.
        """
        changed = self._changed
        if not counts:
            self._lines += 1
            self._marks += 1
            self._quiet += 1
            if changed is not None and arrival - changed > PAUSE_NS:
                self._changed = None
                self._begin()
            return None
        if counts < FAST_TICKS or changed is None:
            self._changed, self._quiet = arrival if counts >= FAST_TICKS else None, 0
            self._pace = float(counts)
            self._begin()
            return None
        took = arrival - changed
        spacing = (self._quiet + 1) * gap
        self._changed, self._quiet = arrival, 0
        number = max(1, round(counts / self._pace))
        if number > 4 or took > PAUSE_NS:
            self._pace = float(counts)
            self._begin()
            return None
        self._pace += 0.5 * (counts / number - self._pace)
        self.spacing = max(spacing, 0.98 * self.spacing)
        if self._warm < WARM_UP:
            self._warm += 1
            if self._warm == WARM_UP:
                self._lines = self._marks = 0
                self._origin = arrival
            return None
        self._lines += 1
        self._marks += number - 1
        self._single += number == 1
        self._number += number
        x, y = float(self._number), arrival - self._origin
        sx, sy, sxx, sxy, syy = self._sums
        self._sums = (sx + x, sy + y, sxx + x * x, sxy + x * y, syy + y * y)
        self._points += 1
        if self._number < ENOUGH_TICKS or y < ENOUGH_NS:
            return None
        # If hardly any change is a single tick, the pace was estimated at half its value.
        measured = self._measure(spread) if 2 * self._single > self._points else None
        if measured is None:
            self._pace = float(counts)
        self._begin()
        self._warm = WARM_UP
        self._origin = arrival
        return measured

    def _measure(self, spread: float) -> Measured:
        sx, sy, sxx, sxy, syy = self._sums
        points = self._points
        across = sxx - sx * sx / points
        period = (sxy - sx * sy / points) / across
        rest = max(0.0, syy - sy * sy / points - period * (sxy - sx * sy / points))
        scatter = math.sqrt(rest / points)
        room = max(0.006 * period, 3.0 * scatter / math.sqrt(across))
        whole = round(period / MS) * MS
        regular = (
            whole >= 2 * MS
            and abs(period - whole) <= min(room, 0.2 * MS)
            and scatter <= 0.35 * spread + 0.4 * MS
        )
        return Measured(period, regular, self._marks >= MARKS_SHARE * self._lines)


class TickPeriod:
    """The period of the totals, chosen from the measurements.

    Args:
        period: The nominal one, in nanoseconds.

    Attributes:
        period: The one that is believed.
        fits: Whether the board's totals follow a regular tick.
        doubt: The share of the period by which the latest measurement disagrees with it.
        notice: The latest finding; the caller clears it.
    """

    __slots__ = "period fits doubt notice _candidate _agreed _misfits".split()

    def __init__(self, period: float) -> None:
        self.period = period
        self.fits = True
        self.doubt = 0.0
        self.notice: Notice | None = None
        self._candidate = 0.0
        self._agreed = 0
        self._misfits = 0

    def misfit(self) -> None:
        """Count lines that stayed late, because their ticks were numbered wrongly."""
        self._misfits += 1

    def weigh(self, measured: Measured) -> bool:
        """Keep the period, change it, or do without.

        Returns:
            Whether ticks have to be numbered again.
        """
        near = abs(measured.period - self.period) <= 0.03 * self.period
        self.doubt = abs(measured.period / self.period - 1.0) if self.fits and not near else 0.0
        if near and self.fits:
            # Straightness does not matter here: delays and lost lines bend it.
            self._agreed = self._misfits = 0
        elif measured.regular and measured.marked:
            period = float(round(measured.period / MS) * MS)
            self._agreed = self._agreed + 1 if period == self._candidate else 1
            self._candidate = period
            if self._agreed >= (AGREE_PERIODS if self.fits else AGREE_AGAIN):
                if period != self.period or not self.fits:
                    self.notice = "period"
                self._agreed = self._misfits = 0
                return self._settle(period, fits=True)
        else:
            self._agreed = 0
            self._misfits += 1
        if self._misfits >= MISFITS and self.fits:
            self.notice = "unfit"
            return self._settle(self.period, fits=False)
        return False

    def _settle(self, period: float, *, fits: bool) -> bool:
        self.period = period
        self.fits = fits
        self.doubt = 0.0
        return True
