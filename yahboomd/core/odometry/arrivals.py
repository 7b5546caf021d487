"""The moments at which lines left the board, from their arrivals.

Law: a board sends its lines evenly, and everything in between delays them at random. So the send
times are a smooth clock along the lower edge of the arrival times.

An alpha-beta filter follows the mean of the arrivals; the lower edge of its residuals belongs to
the lines with the least delay. Good to a few milliseconds under delays of up to 16, at once and in
any state; :mod:`yahboomd.core.odometry.envelope` is ten times better but needs motion.
"""

from __future__ import annotations

import math

ALPHA = 0.1
BETA = 0.005
"""A critically damped filter's gains for a memory of some twenty lines (beta = alpha²/2)."""

FADE = 0.99
"""The rate at which the lower edge is forgotten: half of it in seventy lines."""

CLEAN = 0.15
"""Lines off by less than this share of a gap come evenly (chance alone gives a quarter)."""

EDGE_MAX_NS = 10_000_000
"""Delays are below 16 ms, 8 on average: a larger residual comes from a lost line."""

BREAK_NS = 40_000_000
"""A line this far from its expected time restarts the filter."""

SETTLE_NS = 25_000_000
RUSH = 1.4
"""After a break, lines are counted for this time. If they come faster than this multiple of their
rate, they were held back with others: their send times are unknown, and they are not steady."""

READ_NS = 100_000_000
"""Lines that fill the wire come from a backlog in the same rhythm: a read brings 89 ms of them, and
only the next read shows that they waited."""

RUSH_MOST_NS = 500_000_000
"""No backlog takes longer to arrive; a board that keeps sending faster has changed its rate."""


class Arrivals:
    """A smoothed clock of lines.

    Attributes:
        gap: The mean time from line to line; 0 before the second.
        steady: Whether lines come as fast as they are sent, and not from a backlog.
    """

    __slots__ = "_mean gap _paired _edge _rough _broken steady _since _lines".split()

    def __init__(self) -> None:
        self._mean: float | None = None
        self.gap = 0.0
        self._paired = False
        self._edge = 0.0
        self._rough = 0.0  # mean distance of lines from whole gaps
        self._broken = 0.0  # arrival of the first line after a break
        self.steady = True
        self._since = 0.0  # while not steady: start of the count that shows the rate
        self._lines = 0

    @property
    def spread(self) -> float:
        """The longest delay of a line after its tick: the gap between lines, plus their delays."""
        return self.gap - 2.0 * self._edge

    def add(self, arrival: float, wire: float = 0.0) -> float:
        """Take in a line.

        Args:
            wire: The time that its bytes take on the wire.

        Returns:
            When it left the board, never later than ``arrival``.
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
                # Lines come evenly, and this one is whole gaps late: lines were lost.
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
            # The next read of a backlog: its arrival is corrected for the bytes behind it.
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
