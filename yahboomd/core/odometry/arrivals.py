"""The moments at which lines left the board, from their arrivals.

Law: a board sends its lines evenly, and what comes between delays them by chance. So the times of
leaving are a smooth clock that lies below the times of arrival, at their lower edge.

An alpha-beta filter over the lines follows their mean; the lower edge of what is left over is the
delay that all have. Good to a few milliseconds under delays of up to 16, at once and in any state,
where :mod:`yahboomd.core.odometry.envelope` is ten times better but needs motion.
"""

from __future__ import annotations

import math

ALPHA = 0.1
BETA = 0.005
"""A critically damped filter's gains for a memory of some twenty lines (beta = alpha²/2)."""

FADE = 0.99
"""The rate at which the lower edge is forgotten: half of it in seventy lines."""

CLEAN = 0.15
"""Off by less than this part of a gap, lines come evenly (by pure chance it would be a quarter)."""

EDGE_MAX_NS = 10_000_000
"""Delays are below 16 ms, 8 on the average: what is left over beyond is a line that was lost."""

BREAK_NS = 40_000_000
"""A line so far from where it was expected starts the filter again."""

SETTLE_NS = 25_000_000
RUSH = 1.4
"""After a break, lines that come faster than this for so long were held back with others: when
they left is not known, and the line is not steady."""

READ_NS = 100_000_000
"""Lines that fill the wire come from a backlog in the same rhythm: a read brings 89 ms of them, and
only the next read shows that they had waited."""

RUSH_MOST_NS = 500_000_000
"""No backlog takes longer to arrive; a board that keeps sending faster has changed its rate."""


class Arrivals:
    """A smoothed clock of lines.

    Attributes:
        gap: The time from line to line, on the average; 0 before there are two.
        steady: Whether lines come as fast as they are sent, and not from a backlog.
    """

    __slots__ = "_mean gap _paired _edge _rough _broken steady _since _lines".split()

    def __init__(self) -> None:
        self._mean: float | None = None
        self.gap = 0.0
        self._paired = False
        self._edge = 0.0
        self._rough = 0.0  # how far from whole gaps lines come, on the average
        self._broken = 0.0  # arrival of the first line after a break
        self.steady = True
        self._since = (
            0.0  # where they are not steady: since when lines are counted to see how fast they come
        )
        self._lines = 0

    @property
    def spread(self) -> float:
        """The longest delay of a line after its tick: the gap between lines, and their delays."""
        return self.gap - 2.0 * self._edge

    def add(self, arrival: float, wire: float = 0.0) -> float:
        """Accept a line, and return when it left; never later than it came.

        Args:
            wire: The time that its bytes take.
        """
        if self._mean is None:
            self._mean = arrival
            return arrival
        if not self._paired:
            self._paired = True
            self.gap = max(0.0, min(arrival - self._mean, BREAK_NS))
        if not self.steady:
            return self._settle(arrival, READ_NS if self.gap < RUSH * wire else SETTLE_NS)
        expected = self._mean + self.gap
        off = arrival - expected
        if abs(off) > BREAK_NS:
            self._broken = self._since = arrival
            self.steady = False
            self._lines = 0
            return arrival + self._edge
        if self.gap:
            lost = self.gap * math.floor(off / self.gap + 0.5)
            if lost > 0.0 and self._rough < CLEAN * self.gap:
                # Lines come like clockwork and this one by whole lines too late: some were lost.
                expected += lost
                off -= lost
                lost = 0.0
            self._rough += ALPHA * (abs(off - lost) - self._rough)
        self._mean = expected + ALPHA * off
        self.gap = max(0.0, self.gap + BETA * off)
        self._edge = max(min(arrival - self._mean, self._edge * FADE), -EDGE_MAX_NS)
        return min(arrival, self._mean + self._edge)

    def _settle(self, arrival: float, within: float) -> float:
        took = arrival - self._since
        if took < 0.0:
            # The next read of a backlog: bytes that came behind were taken off its arrival.
            self._since, self._lines = arrival, 0
        else:
            self._lines += 1
            if took >= within:
                if arrival - self._broken > RUSH_MOST_NS:
                    self.gap = took / self._lines
                if self._lines * self.gap <= RUSH * took:
                    self.steady, self._mean = True, arrival
                else:
                    self._since, self._lines = arrival, 0
        return arrival + self._edge
