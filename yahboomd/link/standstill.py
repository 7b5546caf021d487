"""Do the wheels stand? Seen from the raw counters alone, whatever the odometry makes of them."""

from __future__ import annotations

from collections import deque

from yahboomd.clock import NS_PER_S
from yahboomd.model import Counts

_WRAP = 1 << 32
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
        self._readings: deque[tuple[int, Counts]] = deque()

    def forget(self) -> None:
        """Judge from what comes now on (the counters restarted, or a stop was just sent)."""
        self._readings.clear()

    def see(self, ticks: Counts, now_ns: int) -> None:
        """A reading of the counters."""
        readings = self._readings
        readings.append((now_ns, ticks))
        # Keep one reading at or beyond the window's far end, to measure across the whole of it.
        while len(readings) > 2 and readings[1][0] <= now_ns - WINDOW_NS:
            readings.popleft()

    @property
    def speed(self) -> float | None:
        """Counts per second of the fastest wheel; ``None`` before a whole window was seen."""
        if len(self._readings) < 2:
            return None
        (first_ns, first), (last_ns, last) = self._readings[0], self._readings[-1]
        if last_ns - first_ns < WINDOW_NS:
            return None
        steps = (
            (b - a + (_WRAP >> 1)) % _WRAP - (_WRAP >> 1) for a, b in zip(first, last, strict=True)
        )
        return max(abs(step) for step in steps) * NS_PER_S / (last_ns - first_ns)

    @property
    def standing(self) -> bool:
        """Whether every wheel was seen to stand."""
        speed = self.speed
        return speed is not None and speed < self._limit
