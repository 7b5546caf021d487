"""Decides whether a wheel or the line to the board is to blame for a trouble.

Lines have no checksum. If bytes are lost, a speed arrives with a digit less or not at all, and a
healthy wheel obeys the damaged speed. The motors are cut at once either way. A wheel is blamed only
if the line is clean, or if the same trouble repeats whenever the wheel is driven, which chance does
not do. Each recent damage excuses one trouble, because a line that just became bad has shown few.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from yahboomd.core.drive.faults import Fault

AGAIN = 5
NO_COUNTS_AGAIN = 8
ALL_SILENT_AGAIN = 16
"""The repetitions in a row that the line cannot have caused. Losing one speed in two or three
silences a start, and silences all wheels at once."""

FORGOTTEN_NS = 5_000_000_000
"""Two troubles with this time between them are not in a row."""

FOLLOWED_NS = 1_000_000_000
"""A wheel that is driven for this time without trouble follows its commands. A broken wheel shows
its fault within half of it."""


class Doubts:
    """Counts the troubles of all motors since they last followed their commands."""

    def __init__(self) -> None:
        self._troubles = 0
        self._followed_ns = 0
        self._latest_ns = -FORGOTTEN_NS
        self._blamed = False

    def drive(self, step_ns: int) -> None:
        """Add ``step_ns`` in which the wheels were driven fast enough to show a fault."""
        self._followed_ns += step_ns
        if self._followed_ns >= FOLLOWED_NS:
            self._troubles = 0

    def blame(self, now_ns: int, fault: Fault, *, damages: int) -> bool:
        """Decide whether a wheel is to blame for a trouble.

        Troubles of several wheels at the same moment count as one.

        Args:
            damages: How often the line recently damaged bytes.

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
