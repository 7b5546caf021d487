"""Counts recent occurrences in bounded memory, at any rate.

A window consists of equal slices and forgets one slice at a time, so it covers between its length
and one slice more. That is exact enough for drifting clocks and for sentences about the last
seconds.
"""

from __future__ import annotations

from collections import Counter, deque

SLICES = 20


class SlidingMinimum:
    """The smallest value of the last ``window_ns``."""

    def __init__(self, window_ns: int) -> None:
        self._window_ns = window_ns
        self._slice_ns = max(1, window_ns // SLICES)
        self._minima: deque[tuple[int, int]] = deque()

    def add(self, now_ns: int, value: int) -> None:
        self._forget(now_ns)
        index = now_ns // self._slice_ns
        if self._minima and self._minima[-1][0] == index:
            value = min(value, self._minima.pop()[1])
        self._minima.append((index, value))

    def smallest(self, now_ns: int) -> int | None:
        self._forget(now_ns)
        return min((value for _, value in self._minima), default=None)

    def clear(self) -> None:
        self._minima.clear()

    def _forget(self, now_ns: int) -> None:
        oldest = (now_ns - self._window_ns) // self._slice_ns
        while self._minima and self._minima[0][0] < oldest:
            self._minima.popleft()


class SlidingCounts:
    """Counts the occurrences of each thing in the last ``window_ns``."""

    def __init__(self, window_ns: int) -> None:
        self._window_ns = window_ns
        self._slice_ns = max(1, window_ns // SLICES)
        self._slices: deque[tuple[int, Counter[str]]] = deque()

    def add(self, now_ns: int, what: str) -> None:
        self._forget(now_ns)
        index = now_ns // self._slice_ns
        if not self._slices or self._slices[-1][0] != index:
            self._slices.append((index, Counter()))
        self._slices[-1][1][what] += 1

    def counts(self, now_ns: int) -> dict[str, int]:
        self._forget(now_ns)
        total: Counter[str] = Counter()
        for _, counted in self._slices:
            total.update(counted)
        return dict(total)

    def _forget(self, now_ns: int) -> None:
        oldest = (now_ns - self._window_ns) // self._slice_ns
        while self._slices and self._slices[0][0] < oldest:
            self._slices.popleft()
