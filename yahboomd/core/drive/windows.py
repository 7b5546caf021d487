"""Counts recent occurrences in bounded memory, at any rate.

A window consists of equal slices and forgets one slice at a time, so it covers between its length
and one slice more. That is exact enough for drifting clocks and for sentences about the last
seconds.
"""

from __future__ import annotations

from collections import Counter, deque
from typing import Generic, TypeVar

SLICES = 20

Kept = TypeVar("Kept")


class _Slices(Generic[Kept]):
    def __init__(self, window_ns: int) -> None:
        self._slice_ns = max(1, window_ns // SLICES)
        self._window_ns = window_ns
        self._slices: deque[tuple[int, Kept]] = deque()

    def clear(self) -> None:
        self._slices.clear()

    def _recent(self, now_ns: int) -> deque[tuple[int, Kept]]:
        oldest = (now_ns - self._window_ns) // self._slice_ns
        while self._slices and self._slices[0][0] < oldest:
            self._slices.popleft()
        return self._slices


class SlidingMinimum(_Slices[int]):
    """The smallest value of the last ``window_ns``."""

    def add(self, now_ns: int, value: int) -> None:
        minima, index = self._recent(now_ns), now_ns // self._slice_ns
        if minima and minima[-1][0] == index:
            value = min(value, minima.pop()[1])
        minima.append((index, value))

    def smallest(self, now_ns: int) -> int | None:
        return min((value for _, value in self._recent(now_ns)), default=None)


class SlidingCounts(_Slices[Counter[str]]):
    """Counts the occurrences of each thing in the last ``window_ns``."""

    def add(self, now_ns: int, what: str, times: int = 1) -> None:
        slices, index = self._recent(now_ns), now_ns // self._slice_ns
        if not slices or slices[-1][0] != index:
            slices.append((index, Counter()))
        slices[-1][1][what] += times

    def counts(self, now_ns: int) -> dict[str, int]:
        total: Counter[str] = Counter()
        for _, counted in self._recent(now_ns):
            total.update(counted)
        return dict(total)
