"""The least speed that counts prove, however late the readings came.

Between the moment at which a board was asked and the one at which its answer was there, it sampled
its counters; when is unknown. On a machine that is busy that may be a while, and the speed that
follows from one guess of it may be several times the true one. Counts over the longest time in
which they can have been counted are never too fast: what is to stop a robot should be proven.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

NS_PER_S = 1_000_000_000

WINDOW_NS = 40_000_000
"""Counts are taken over so long at least, so that the time an answer takes matters little."""


class ProvenSpeeds:
    """Follows the travelled counts of all motors.

    Args:
        metres_per_tick: Rim travel of one count, for each motor.
    """

    def __init__(self, metres_per_tick: Sequence[float]) -> None:
        self._metres_per_tick = tuple(metres_per_tick)
        self._past: deque[tuple[int, tuple[int, ...]]] = deque()

    def forget(self) -> None:
        """Begin again: it is unknown what happened since."""
        self._past.clear()

    def see(
        self, earliest_ns: int, latest_ns: int, ticks: tuple[int, ...]
    ) -> tuple[float, ...] | None:
        """Take in a reading.

        Args:
            earliest_ns: The board sampled it no earlier.
            latest_ns: And no later.
            ticks: Travelled counts of each motor since the start.

        Returns:
            Rim speeds, m/s, that no wheel was slower than on the average since some 40 ms ago;
            None before there is anything to compare with.
        """
        past = self._past
        past.append((earliest_ns, ticks))
        while len(past) > 2 and past[1][0] <= latest_ns - WINDOW_NS:
            past.popleft()
        since_ns, before = past[0]
        if len(past) < 2 or latest_ns <= since_ns:
            return None
        return tuple(
            [
                (now - then) * each * NS_PER_S / (latest_ns - since_ns)
                for now, then, each in zip(ticks, before, self._metres_per_tick, strict=True)
            ]
        )
