"""When lines left the board, from when they arrived.

Law: a board sends its lines evenly, and what comes between delays them by chance. So the times of
leaving are a smooth clock that lies below the times of arrival, at their lower edge.

An alpha-beta filter over the lines follows their mean; the lower edge of what is left over is the
delay that all have. Good to a few milliseconds under delays of up to 16, at once and in any state,
where :mod:`yahboomd.odometry.envelope` is ten times better but needs motion.
"""

from __future__ import annotations

import math

ALPHA = 0.1
BETA = 0.005
"""A critically damped filter's gains for a memory of some twenty lines (beta = alpha²/2)."""

FADE = 0.99
"""How slowly the lower edge is forgotten: half of it in seventy lines."""

CLEAN = 0.15
"""Off by less than this part of a gap, lines come evenly (by pure chance it would be a quarter)."""

EDGE_MAX_NS = 10_000_000
"""Delays are below 16 ms, 8 on the average: what is left over beyond is a line that was lost."""

BREAK_NS = 40_000_000
"""A line so far from where it was expected starts the filter anew."""


class Arrivals:
    """A smoothed clock of lines."""

    def __init__(self) -> None:
        self._mean: float | None = None
        self._gap: float | None = None
        self._edge = 0.0
        self._rough = 0.0  # how far from whole gaps lines come, on the average

    @property
    def gap(self) -> float:
        """From line to line, on the average."""
        return self._gap or 0.0

    @property
    def spread(self) -> float:
        """How long after its tick a line may come: the gap between lines, and their delays."""
        return (self._gap or 0.0) - 2.0 * self._edge

    def forget(self) -> None:
        """Start anew with the next line."""
        self._mean = None
        self._gap = None

    def add(self, arrival: float) -> float:
        """Take in a line and say when it left; never later than it came."""
        if self._mean is None:
            self._mean = arrival
            return arrival + self._edge
        if self._gap is None:
            self._gap = arrival - self._mean
        expected = self._mean + self._gap
        off = arrival - expected
        if abs(off) > BREAK_NS:
            self._mean = arrival
            return arrival + self._edge
        if self._gap:
            lost = self._gap * math.floor(off / self._gap + 0.5)
            if lost > 0.0 and self._rough < CLEAN * self._gap:
                # Lines come like clockwork and this one by whole lines too late: some were lost.
                expected += lost
                off -= lost
                lost = 0.0
            self._rough += ALPHA * (abs(off - lost) - self._rough)
        self._mean = expected + ALPHA * off
        self._gap = max(0.0, self._gap + BETA * off)
        self._edge = max(min(arrival - self._mean, self._edge * FADE), -EDGE_MAX_NS)
        return min(arrival, self._mean + self._edge)
