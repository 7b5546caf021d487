"""Whether a wheel is to blame for what it did, or the line to the board.

Lines have no checksum. Where bytes are lost, a speed arrives with a digit less or not at all, and a
healthy wheel obeys what arrived. The motors are cut at once either way, but a wheel is blamed only
where the line is clean, or where the same happens again and again as soon as it is driven: chance
does not. Each damage seen lately excuses one trouble: a line that just became bad has shown few.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from yahboomd.core.drive.faults import Fault

AGAIN = 5
NO_COUNTS_AGAIN = 8
ALL_SILENT_AGAIN = 16
"""The repetitions in a row that the line cannot have caused. One lost speed in two or three
silences a start, and all wheels at once."""

FORGOTTEN_NS = 5_000_000_000
"""Two things that lie so far apart are not in a row."""

FOLLOWED_NS = 1_000_000_000
"""A wheel that is driven for so long without trouble follows its commands. A broken one shows it
within half of that."""


class Doubts:
    """Follows the troubles of all motors since they last followed their commands."""

    def __init__(self) -> None:
        self._troubles = 0
        self._followed_ns = 0
        self._latest_ns = -FORGOTTEN_NS
        self._blamed = False

    def drive(self, step_ns: int) -> None:
        """The wheels were driven for another ``step_ns``, fast enough to show a fault."""
        self._followed_ns += step_ns
        if self._followed_ns >= FOLLOWED_NS:
            self._troubles = 0

    def blame(self, now_ns: int, fault: Fault, *, damages: int) -> bool:
        """Decide who is to blame for a trouble that was found.

        Troubles of several wheels at the same moment count as one.

        Args:
            damages: How often the line damaged something lately.

        Returns:
            Whether the wheel is to blame, not the line.
        """
        if now_ns != self._latest_ns:
            if self._blamed or now_ns - self._latest_ns >= FORGOTTEN_NS:
                self._troubles = 0
            self._blamed = False
            self._latest_ns = now_ns
            self._followed_ns = 0
            self._troubles += 1
        often = 1 if fault.certain else min(damages + 1, _often(fault))
        blamed = self._troubles >= often
        self._blamed = self._blamed or blamed
        return blamed


def _often(fault: Fault) -> int:
    if fault.kind != "no_counts":
        return AGAIN
    return ALL_SILENT_AGAIN if fault.motor is None else NO_COUNTS_AGAIN
