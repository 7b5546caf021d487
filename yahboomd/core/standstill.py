"""Standing wheels: the one definition of the program, and the figures of a stop.

A board that holds its wheels lets them hunt: by up to 8 counts on the vendor's firmware, which are
1.3 mm. That is no motion. One reading proves neither standstill nor motion: a wheel that swings
through zero shows a slow one, and a digit may be garbled.
"""

from __future__ import annotations

from collections.abc import Sequence

from yahboomd.core.counts import CountHistory, unwrapped
from yahboomd.core.model import NS_PER_S, Counts

STANDING_M_S = 0.03
"""A rim slower than this stands. Hunting by 1.3 mm within the window of counts is 22 mm/s."""

PROVEN_NS = 30_000_000
"""The time over which readings prove it: two of them at the slowest sensible poll rate, several at
the usual rates."""

WINDOW_NS = 60_000_000
"""The window of a speed from raw counts: six renewals of a board that streams, five steps of a slow
poll. A mean over it needs no further proof."""

STILL_TICKS_PER_S = 100.0
"""The limit in counts if no wheel is configured: six counts in the window, at most 25 mm/s at the
rim with any of the vendor's gears that has an encoder."""

HUNTS_M = 0.002
"""A wheel that stays within this of its place rests, although its board hunts."""

UNMOVED_S = 2.0
"""Wheels that are commanded for this time and keep to their places do not turn."""

STAND_WITHIN_S = 0.6
"""The time that a stopped wheel has to stand before the next harder stop."""

REPEAT_S = 0.1
"""The period at which a stop is repeated until then."""


def turning(speeds_m_s: Sequence[float]) -> bool:
    """Whether this reading shows a wheel that turns."""
    return any(abs(speed) >= STANDING_M_S for speed in speeds_m_s)


class Standstill:
    """The proof by measured speeds: every reading over :data:`PROVEN_NS` shows all wheels slow.

    Attributes:
        since_ns: When the first of those readings was sampled; None if the latest shows a wheel
            that turns, or there is none.
    """

    def __init__(self) -> None:
        self.since_ns: int | None = None

    def measure(self, stamp_ns: int, speeds_m_s: Sequence[float]) -> bool:
        """Add a reading; returns whether standstill is proven."""
        if not speeds_m_s or turning(speeds_m_s):
            self.since_ns = None
        elif self.since_ns is None:
            self.since_ns = stamp_ns
        return self.since_ns is not None and stamp_ns - self.since_ns >= PROVEN_NS


class CountedStandstill:
    """The proof by raw counts, where no geometry is known: the fastest wheel over the window.

    Args:
        ticks_per_s: Below it a wheel stands.
    """

    def __init__(self, ticks_per_s: float = STILL_TICKS_PER_S) -> None:
        self._limit = ticks_per_s
        self._history = CountHistory(WINDOW_NS)

    def reset(self) -> None:
        """Judge by later readings only (the counters restarted, or a stop was just sent)."""
        self._history.clear()

    def add(self, ticks: Counts, now_ns: int) -> None:
        self._history.add(now_ns, ticks)

    @property
    def speed(self) -> float | None:
        """Counts per second of the fastest wheel; ``None`` before a whole window was seen."""
        found = self._history.since(WINDOW_NS)
        if found is None or found[0] < WINDOW_NS:
            return None
        span_ns, steps = found
        return max(abs(unwrapped(step)) for step in steps) * NS_PER_S / span_ns

    @property
    def standing(self) -> bool:
        speed = self.speed
        return speed is not None and speed < self._limit
