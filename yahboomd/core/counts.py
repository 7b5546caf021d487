"""The recent history of the counters, and the speeds of the wheels by it.

Law: a speed is counts over the longest time that they can have taken. If the moment of each
reading is known, that is the mean speed; if only a span is known, it is a lower bound.

A line without a checksum sometimes garbles a digit, and the result may look like travel.
One such reading makes every speed wrong that begins or ends at it; the median of the speeds between
all pairs of readings (H. Theil, *A rank-invariant method of linear and polynomial regression
analysis*, 1950; P. K. Sen, 1968) stays right if a quarter of them is garbled.
"""

from __future__ import annotations

import math
from collections import deque
from itertools import combinations, islice
from statistics import median

import msgspec

from yahboomd.core.model import NS_PER_S

WRAP = 1 << 32
"""The board counts in int32: 2147483647 is followed by -2147483648."""

HALF = WRAP >> 1

WITNESSED_NS = 80_000_000
"""Witnesses are no older than this: a wheel that runs away must be cut within 150 ms of showing
it, and the median shows it when half of the pairs do."""

APART_NS = 25_000_000
"""Readings that lie closer together do not show a speed."""

ENOUGH = 5
"""The readings that prove a speed; any one of them may be wrong."""

SELDOM = 3
SELDOM_NS = 200_000_000
"""The readings that suffice if they are so rare that ``ENOUGH`` would take longer."""


def unwrapped(step: int) -> int:
    """The difference of two values of a counter, the short way round."""
    return (step + HALF) % WRAP - HALF


def slowest(*speeds: float) -> float:
    """The speed of the smallest magnitude; 0 if the signs differ."""
    return max(min(speeds), min(0.0, max(speeds)))


class Reading(msgspec.Struct, frozen=True):
    """Counts of all motors.

    Attributes:
        earliest_ns: The earliest time at which the board can have sampled them.
        latest_ns: The latest.
        totals: Counts of each motor since any start.
    """

    earliest_ns: int
    latest_ns: int
    totals: tuple[int, ...]


class CountHistory:
    """The latest readings of all motors.

    Args:
        keep_ns: How far back they reach; the newest reading at least this old is kept too.
        least: The number that is kept at any age.
    """

    __slots__ = "_keep_ns _least _readings".split()

    def __init__(self, keep_ns: int, least: int = 2) -> None:
        self._keep_ns = keep_ns
        self._least = least
        self._readings: deque[Reading] = deque()

    @property
    def latest_ns(self) -> int | None:
        """The latest moment at which the newest reading was sampled; None without a reading."""
        return self._readings[-1].latest_ns if self._readings else None

    def clear(self) -> None:
        self._readings.clear()

    def add(self, at_ns: int, totals: tuple[int, ...], earliest_ns: int | None = None) -> None:
        """Add a reading, in the order of time.

        Args:
            at_ns: When it was sampled; the latest possible time if that is not known.
            earliest_ns: The earliest possible time; None if ``at_ns`` is exact.
        """
        readings = self._readings
        readings.append(Reading(at_ns if earliest_ns is None else earliest_ns, at_ns, totals))
        while len(readings) > self._least and at_ns - readings[1].latest_ns >= self._keep_ns:
            readings.popleft()

    def drop_latest(self) -> None:
        if self._readings:
            self._readings.pop()

    def since(
        self, shortest_ns: int = 0, longest_ns: float = math.inf, enough_ticks: float = 0
    ) -> tuple[int, tuple[int, ...]] | None:
        """Counts up to the latest reading, over the shortest time that shows a speed.

        Args:
            shortest_ns: Over at least this time, if readings reach back to it.
            longest_ns: Over at most this time, unless readings lie farther apart.
            enough_ticks: Back to a reading since which the busiest motor has this many counts.

        Returns:
            The longest time that they can have taken, and the counts of each motor; None if
            there is no time between those readings.
        """
        readings = self._readings
        if len(readings) < 2:
            return None
        now, chosen = readings[-1], readings[-2]
        if enough_ticks and now.totals == chosen.totals == readings[0].totals:
            # At rest there is nothing to look for.
            chosen = readings[0]
        else:
            for reading in islice(reversed(readings), 1, None):
                span_ns = now.latest_ns - reading.earliest_ns
                if span_ns > longest_ns and reading is not chosen:
                    break
                chosen = reading
                enough = span_ns >= shortest_ns and enough_ticks < math.inf
                if enough and _counted(now, reading, enough_ticks):
                    break
        span_ns = now.latest_ns - chosen.earliest_ns
        if span_ns <= 0:
            return None
        deltas = [one - other for one, other in zip(now.totals, chosen.totals, strict=True)]
        return span_ns, tuple(deltas)

    def witnessed(self, motor: int, after_ns: int | None = None) -> float | None:
        """The speed of one motor that readings agree on, if any one of them was garbled.

        Args:
            motor: Its index in the totals.
            after_ns: Readings up to then are ignored.

        Returns:
            Counts in a second: the slowest of the medians that leave one reading out; None if
            readings are too few.
        """
        heard = [
            (reading.latest_ns, reading.totals[motor])
            for reading in self._readings
            if after_ns is None or reading.latest_ns > after_ns
        ]
        while len(heard) > SELDOM:
            age_ns = heard[-1][0] - heard[0][0]
            if age_ns <= WITNESSED_NS or (len(heard) <= ENOUGH and age_ns <= SELDOM_NS):
                break
            del heard[0]
        if len(heard) >= ENOUGH:
            subsets = [*combinations(heard, len(heard) - 1)]
        elif len(heard) >= SELDOM and heard[-1][0] - heard[0][0] >= SELDOM_NS // 2:
            subsets = [tuple(heard)]
        else:
            return None
        speeds = [speed for subset in subsets if (speed := _median(subset)) is not None]
        return slowest(*speeds) * NS_PER_S if speeds else None


def _counted(now: Reading, then: Reading, enough_ticks: float) -> bool:
    for one, other in zip(now.totals, then.totals, strict=True):
        if one - other >= enough_ticks or other - one >= enough_ticks:
            return True
    return False


def _median(heard: tuple[tuple[int, int], ...]) -> float | None:
    """Counts in a nanosecond, the median over all pairs that lie far enough apart."""
    speeds = [
        (total - before) / (at_ns - before_ns)
        for index, (at_ns, total) in enumerate(heard)
        for before_ns, before in heard[:index]
        if at_ns - before_ns >= APART_NS
    ]
    return median(speeds) if speeds else None
