"""How noisy is the line? What it damages on its way here, it damages in the other direction too."""

from __future__ import annotations

from collections import deque

NOISY_DAMAGES = 5
NOISY_NS = 10_000_000_000
"""A line that damaged so many chunks in so long damages others. A board that was reset cuts a line
or two; and a question without an answer is no damage, since a busy computer has such, too."""

DAMAGES_MOST = 16
"""Damages of the last ten seconds are counted up to here."""


class LineNoise:
    """Counts the chunks that came damaged lately."""

    def __init__(self) -> None:
        self._damage = 0
        self._damaged_ns: deque[int] = deque(maxlen=DAMAGES_MOST)

    def heard(self, damage: int, now_ns: int) -> None:
        """A chunk came.

        Args:
            damage: What was damaged since the port was opened; more than before, if in this chunk.
            now_ns: Now.
        """
        if damage != self._damage:
            self._damage = damage
            self._damaged_ns.append(now_ns)

    def damages(self, now_ns: int) -> int:
        """How many chunks came damaged in the last ten seconds, up to 16."""
        damaged_ns = self._damaged_ns
        while damaged_ns and damaged_ns[0] <= now_ns - NOISY_NS:
            damaged_ns.popleft()
        return len(damaged_ns)
