"""Rates, rises and scales over the latest seconds. Pure; monotonic nanoseconds handed in."""

from __future__ import annotations

from collections import deque

NS_PER_S = 1_000_000_000


class Rate:
    """How often something happens a second, from its counter.

    Args:
        window_ns: The average is taken over so long.
    """

    def __init__(self, window_ns: int = 2 * NS_PER_S) -> None:
        self._window_ns = window_ns
        self._points: deque[tuple[int, int]] = deque()
        self._total = 0

    def total(self, total: int | None, now_ns: int) -> None:
        """The counter shows ``total`` now; None for unknown.

        A counter that fell was restarted. After that, and after a silence longer than the window,
        the average begins again.
        """
        silent = bool(self._points) and now_ns - self._points[-1][0] > self._window_ns
        if total is None or total < self._total or silent:
            self._points.clear()
        if total is None:
            return
        self._total = total
        self._points.append((now_ns, total))
        # One point from before the window stays, so that the average spans it whole.
        while len(self._points) > 2 and self._points[1][0] <= now_ns - self._window_ns:
            self._points.popleft()

    def per_s(self, now_ns: int) -> float | None:
        """The average; None before two counts, 0 when none has come for a window."""
        if not self._points:
            return None
        if now_ns - self._points[-1][0] > self._window_ns:
            return 0.0
        (first_ns, first), (last_ns, last) = self._points[0], self._points[-1]
        if last_ns == first_ns:
            return None
        return (last - first) * NS_PER_S / (last_ns - first_ns)


class Rise:
    """Notices when a counter rises.

    Args:
        value: Its first count, which is no rise.
        lately_ns: How long a rise is news.
    """

    def __init__(self, value: int, lately_ns: int = 10 * NS_PER_S) -> None:
        self._value = value
        self._lately_ns = lately_ns
        self._rose_ns: int | None = None

    def see(self, value: int, now_ns: int) -> None:
        """The counter shows this now."""
        if value > self._value:
            self._rose_ns = now_ns
        self._value = value

    def rising(self, now_ns: int) -> bool:
        """Whether it rose within ``lately_ns``."""
        return self._rose_ns is not None and now_ns - self._rose_ns <= self._lately_ns


class Scale:
    """The largest recent magnitude, for bars that are neither clipped nor dwarfed for ever.

    Args:
        smallest: The lower bound of the scale.
        lately_ns: A value counts for so long, and for up to twice as long.
    """

    def __init__(self, smallest: float, lately_ns: int = 10 * NS_PER_S) -> None:
        self._smallest = smallest
        self._lately_ns = lately_ns
        self._began_ns = 0
        self._before = self._now = smallest

    def see(self, *values: float, now_ns: int) -> None:
        """These are the values now."""
        if now_ns - self._began_ns > self._lately_ns:
            self._before, self._now, self._began_ns = self._now, self._smallest, now_ns
        self._now = max((self._now, *map(abs, values)))

    @property
    def full(self) -> float:
        """The value of a full bar."""
        return max(self._before, self._now)
