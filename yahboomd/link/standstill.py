"""Do the wheels stand? Seen from the raw counters alone, whatever the odometry makes of them."""

from __future__ import annotations

from yahboomd.counts import CountHistory, unwrapped
from yahboomd.model import NS_PER_S, Counts

WINDOW_NS = 60_000_000
"""Speed is judged over so long: six of the streamed board's ticks, five steps of a slow poll."""


class StandstillWatch:
    """Measures the fastest wheel over the latest window.

    Args:
        ticks_per_s: Below it a wheel counts as standing (30 mm/s at the rim, in the counts of the
            wheels in use).
    """

    def __init__(self, ticks_per_s: float) -> None:
        self._limit = ticks_per_s
        self._history = CountHistory(WINDOW_NS)

    def forget(self) -> None:
        """Judge from what comes now on (the counters restarted, or a stop was just sent)."""
        self._history.clear()

    def see(self, ticks: Counts, now_ns: int) -> None:
        """A reading of the counters."""
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
        """Whether every wheel was seen to stand."""
        speed = self.speed
        return speed is not None and speed < self._limit
