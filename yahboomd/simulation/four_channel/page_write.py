"""A write of the four-channel board's flash: one page, which is erased and filled."""

from __future__ import annotations

from bisect import bisect
from random import Random

from yahboomd.simulation.four_channel.flash import FlashContent, cut_short

PREPARE_NS = 280_000
"""The time before an erasure, in which interrupts still come."""

ERASE_NS = (20_000_000, 40_000_000, 30_000_000)
FILL_NS = (43_000_000, 74_000_000, 55_650_000)
"""The page is erased, the processor halted, then filled: least, most, typical."""

VALUES_NS = (
    *(430_000, 500_000, 880_000, 1_330_000),
    *(2_230_000, 3_500_000, 3_650_000, 4_030_000),
)
"""When each value is in the page, after it is empty; most of the time goes into its empty rest."""


class PageWrite:
    """The flash's page on the way from one content to another.

    Attributes:
        begin_ns: When the processor is halted.
        erased_ns: When it is empty, and the processor goes on.
        filled_ns: When the write is done.
    """

    def __init__(
        self, before: FlashContent, content: FlashContent, now_ns: int, random: Random
    ) -> None:
        self._before = before
        self._content = content
        self.begin_ns = now_ns + PREPARE_NS
        self.erased_ns = self.begin_ns + _duration_ns(ERASE_NS, random)
        self.filled_ns = self.erased_ns + _duration_ns(FILL_NS, random)

    def halts_until_ns(self, at_ns: int) -> int:
        """The moment at which a processor halted at ``at_ns`` goes on; ``at_ns`` if it is not."""
        return self.erased_ns if self.begin_ns <= at_ns < self.erased_ns else at_ns

    def left(self, at_ns: int) -> FlashContent:
        """The flash after a loss of power at ``at_ns``: factory settings if the page was empty."""
        if at_ns < self.begin_ns:
            return self._before
        if at_ns < self.erased_ns:
            return FlashContent()
        return cut_short(self._content, bisect(VALUES_NS, at_ns - self.erased_ns))

    def some_moment_ns(self, random: Random) -> int:
        """A moment of the erasure, or of those in which values are written."""
        return self.erased_ns + random.choice((-1, 0, *VALUES_NS[:-1]))


def _duration_ns(bounds_ns: tuple[int, int, int], random: Random) -> int:
    least, most, typical = bounds_ns
    return round(random.triangular(least, most, typical))
