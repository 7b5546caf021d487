"""Finds out whether a counter rises, and how fast. Pure; monotonic nanoseconds are arguments."""

from __future__ import annotations

from collections import deque

from yahboomd.core.model import NS_PER_S


class Counter:
    """A counter's values in the latest seconds."""

    def __init__(self, window_ns: int) -> None:
        self._window_ns = window_ns
        self._counts: deque[tuple[int, int]] = deque()

    def add(self, count: int, now_ns: int) -> None:
        """Record the counter's value now.

        A counter that fell was restarted. After that, and after a silence longer than the window,
        rates begin again.
        """
        if self._counts and (count < self._counts[-1][1] or self._silent(now_ns)):
            self._counts.clear()
        self._counts.append((now_ns, count))
        # Keeps one value from before the window, so that a rate spans all of it.
        while len(self._counts) > 2 and self._counts[1][0] <= now_ns - self._window_ns:
            self._counts.popleft()

    def per_s(self, now_ns: int) -> float | None:
        """The average rate; None before two values, 0 if none came within the window."""
        if not self._counts:
            return None
        if self._silent(now_ns):
            return 0.0
        (first_ns, first), (last_ns, last) = self._counts[0], self._counts[-1]
        return None if last_ns == first_ns else (last - first) * NS_PER_S / (last_ns - first_ns)

    def rising(self, now_ns: int) -> bool:
        """Whether it rose within the window."""
        return bool(self.per_s(now_ns))

    def _silent(self, now_ns: int) -> bool:
        return now_ns - self._counts[-1][0] > self._window_ns
