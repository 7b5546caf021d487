"""A straight line under a cloud of points: phase and period of a clock seen through delays.

Law: delays only add. A line that tick ``n`` caused arrives at ``phase + n · period`` plus a delay
that is sometimes almost zero. So the clock is the straight line below all points that comes closest
to them. Its slope is that of an edge of the lower convex hull: the one over the most important
point of time (Moon, Skelly and Towsley, *Estimation and removal of clock
skew from network delay measurements*, INFOCOM 1999).
"""

from __future__ import annotations

import math
from itertools import pairwise

BLOCK = 16
"""Each block of this many points is reduced to its lowest one."""

BLOCKS_MAX = 256
SETTLED_BLOCKS = 4
SETTLED_ANYHOW = 16
SETTLED_NS = 1_000_000
"""The line is settled when the last blocks' lowest points agree this well, or after this many."""

SLOPE_TICKS = 400
"""Over a shorter stretch the slope would be mostly noise; the last one known is kept."""

FRESH_TICKS = 150
"""The ticks that the phase looks back on while the slope is unknown: 500 ppm are 0.75 ms then."""

DRIFT_MAX = 1e-3
"""Crystals and ceramic resonators are better than this."""


class Envelope:
    """The lower envelope of arrival times over tick numbers.

    Args:
        period: The nominal period, in the unit of the arrival times.
    """

    __slots__ = "_period drift _drift_known settled _offset _blocks _count _low".split()

    def __init__(self, period: float) -> None:
        self._period = period
        self.drift = 0.0
        self._drift_known = False
        self.settled = False
        self._offset = math.inf  # of the line at tick 0, the nominal period taken off
        self._blocks: list[tuple[int, float]] = []
        self._count = 0
        self._low = (0, math.inf)

    def at(self, tick: int) -> float:
        return self._offset + tick * (self._period + self.drift)

    def reset(self) -> None:
        self.settled = False
        self._offset = math.inf
        self._blocks.clear()
        self._start_block()

    def add(self, tick: int, arrival: float) -> None:
        rest = arrival - tick * self._period
        if rest - self.drift * (tick - self._low[0]) < self._low[1]:
            self._low = (tick, rest)
        # The line falls at once; it rises only when blocks are fitted.
        self._offset = min(self._offset, rest - self.drift * tick)
        self._count += 1
        if self._count == BLOCK:
            self._blocks.append(self._low)
            del self._blocks[:-BLOCKS_MAX]
            self._start_block()
            self._fit()

    def _start_block(self) -> None:
        self._count = 0
        self._low = (0, math.inf)

    def _fit(self) -> None:
        blocks = self._blocks
        last = blocks[-1][0]
        if last - blocks[0][0] >= SLOPE_TICKS:
            slope = _slope(blocks)
            if slope is not None:
                limit = DRIFT_MAX * self._period
                self.drift = max(-limit, min(limit, slope))
                self._drift_known = True
        rests = [rest - self.drift * tick for tick, rest in blocks[-SETTLED_BLOCKS:]]
        agree = len(rests) == SETTLED_BLOCKS and max(rests) - min(rests) < SETTLED_NS
        if not self.settled and (agree or len(blocks) >= SETTLED_ANYHOW):
            # Earlier points may be numbered differently.
            del blocks[:-SETTLED_BLOCKS]
            self.settled = True
        # A longer stretch gives a better slope, which carries farther back.
        reach = (
            max(SLOPE_TICKS, (last - blocks[0][0]) * 3 // 4) if self._drift_known else FRESH_TICKS
        )
        rests = [rest - self.drift * tick for tick, rest in blocks if last - tick <= reach]
        lowest = min(rests)
        if len(rests) >= SETTLED_BLOCKS:
            # Even the lowest point was delayed a little. If a delay is the sum of two, the least of
            # N falls with the root of N: so the mean of the blocks shows how much is left.
            mean = sum(rests) / len(rests)
            lowest -= (mean - lowest) / (math.sqrt(len(rests)) - 1.0)
        self._offset = lowest


def _slope(points: list[tuple[int, float]]) -> float | None:
    """The slope of the hull's edge over the weighted middle; None if it is too short."""
    hull: list[tuple[int, float]] = []
    for point in points:
        while len(hull) >= 2 and _above(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    first, last = points[0][0], points[-1][0]
    # Two thirds into the window: recent, and yet with points on both sides.
    middle = first + (last - first) * 2 // 3
    for left, right in pairwise(hull):
        if left[0] <= middle <= right[0] and right[0] - left[0] >= SLOPE_TICKS // 2:
            return (right[1] - left[1]) / (right[0] - left[0])
    return None


def _above(a: tuple[int, float], b: tuple[int, float], c: tuple[int, float]) -> bool:
    """Whether ``b`` lies on or above the line from ``a`` to ``c``."""
    return (b[1] - a[1]) * (c[0] - a[0]) >= (c[1] - a[1]) * (b[0] - a[0])
