"""The speed that most readings agree on.

A line without a checksum garbles a digit now and then, and what comes of it may look like travel.
One reading makes every speed wrong that is taken from it or to it; the median of the speeds between
all pairs of readings (H. Theil, *A rank-invariant method of linear and polynomial regression
analysis*, 1950; P. K. Sen, 1968) does not care, up to more than a quarter of them garbled.
"""

from __future__ import annotations

from collections import deque
from statistics import median

NS_PER_S = 1_000_000_000

WINDOW_NS = 80_000_000
"""Readings older than this are heard no more: a wheel that runs away has to be cut within 150 ms of
showing it, and the median shows it when half of the pairs do."""

APART_NS = 25_000_000
"""Readings that lie closer together tell too little of a speed."""

ENOUGH = 5
"""So many readings are heard at least, and any one of them may be wrong."""

SELDOM = 3
LONGEST_NS = 200_000_000
"""Where readings are so seldom that ENOUGH would take longer, these have to do."""


class Witnesses:
    """The readings of one motor of late.

    Args:
        metres_per_tick: Rim travel of one count.
    """

    def __init__(self, metres_per_tick: float) -> None:
        self._metres_per_tick = metres_per_tick
        self._heard: deque[tuple[int, int]] = deque()
        self._total = 0

    def forget(self) -> None:
        """Begin again: it is unknown what the wheel did."""
        self._heard.clear()

    def hear(self, at_ns: int, ticks: int) -> None:
        """Take in a reading: what was counted since the last one, and when it arrived."""
        self._total += ticks
        heard = self._heard
        heard.append((at_ns, self._total))
        while len(heard) > SELDOM:
            age_ns = at_ns - heard[0][0]
            if age_ns <= WINDOW_NS or (len(heard) <= ENOUGH and age_ns <= LONGEST_NS):
                break
            heard.popleft()

    def speed_m_s(self) -> float | None:
        """The speed that they agree on whichever of them was garbled, positive forward.

        Returns:
            The one nearest to standing; None where readings are too few to tell.
        """
        heard = list(self._heard)
        if len(heard) >= ENOUGH:
            juries = [heard[:index] + heard[index + 1 :] for index in range(len(heard))]
        elif len(heard) >= SELDOM and heard[-1][0] - heard[0][0] >= LONGEST_NS // 2:
            juries = [heard]
        else:
            return None
        speeds = [speed for jury in juries if (speed := _median(jury)) is not None]
        if not speeds or min(speeds) <= 0.0 <= max(speeds):
            return 0.0 if speeds else None
        return min(speeds, key=abs) * self._metres_per_tick * NS_PER_S


def _median(heard: list[tuple[int, int]]) -> float | None:
    """Counts in a nanosecond, the median over all pairs that lie far enough apart."""
    speeds = [
        (total - before) / (at_ns - before_ns)
        for index, (at_ns, total) in enumerate(heard)
        for before_ns, before in heard[:index]
        if at_ns - before_ns >= APART_NS
    ]
    return median(speeds) if speeds else None
