"""Estimates the offset of a command source's clock by its stamps, and explains its effect.

A stamp is the sender's time when it sent. Less this machine's time at the arrival, it is the
difference of the clocks, less the delay on the way; the largest of the last ten seconds had the
shortest delay. Nothing is refused here: :mod:`~yahboomd.core.drive.age` judges the age of a
command. The offset is published for a person who wonders why a robot stands, or why its transforms
do not fit those of another machine.
"""

from __future__ import annotations

from yahboomd.core.drive.age import HISTORY_NS, StampPolicy
from yahboomd.core.drive.windows import SlidingMinimum

NOTICEABLE_S = 0.1
"""Closer clocks agree: the way takes milliseconds, and lookups of transforms in ROS 2 allow at
least this much."""

_NO_MISTAKE_S = 3e7
"""A clock a year off was not set wrongly: it counts from another start, such as simulated time."""


class ClockOffset:
    """The clock of one source.

    Args:
        policy: The use of stamps (:mod:`~yahboomd.core.drive.age`).
        timeout_ns: The time for which its commands are valid.
    """

    def __init__(self, policy: StampPolicy, timeout_ns: int) -> None:
        self._policy = policy
        self._timeout_ns = timeout_ns
        self._behind = SlidingMinimum(HISTORY_NS)

    def saw(self, now_ns: int, stamp_ns: int | None, wall_ns: int | None) -> None:
        """Add a stamp that arrived at ``now_ns`` (monotonic), ``wall_ns`` by this machine's clock.

        A missing stamp, and 0 (ROS's value for one), are ignored.
        """
        if stamp_ns is not None and stamp_ns > 0 and wall_ns is not None:
            self._behind.add(now_ns, wall_ns - stamp_ns)

    def ahead_s(self, now_ns: int) -> float | None:
        """The source's clock less this one, in seconds; ``None`` without recent stamps."""
        behind_ns = self._behind.smallest(now_ns)
        return None if behind_ns is None else -behind_ns / 1e9

    def warning(self, now_ns: int) -> str | None:
        """Describe the offset, its effect and its remedy; ``None`` while the clocks agree."""
        ahead_s = self.ahead_s(now_ns)
        if ahead_s is None or abs(ahead_s) <= NOTICEABLE_S:
            return None
        where = "ahead of" if ahead_s > 0.0 else "behind"
        return (
            f"Its clock is {abs(ahead_s):.2f} s {where} this machine's"
            f"{', as if it used simulated time' if abs(ahead_s) > _NO_MISTAKE_S else ''}. "
            f"{self._consequence(ahead_s)}"
        )

    def _consequence(self, ahead_s: float) -> str:
        if self._policy == "absolute":
            if abs(ahead_s) * 1e9 <= self._timeout_ns:
                seem = "younger" if ahead_s > 0.0 else "older"
                done = f"Its commands seem {seem} than they are"
                return f"{done} (command.stamps is absolute): synchronise the clocks."
            return (
                "All its commands are refused (command.stamps is absolute): synchronise the "
                'clocks, or set command.stamps to "relative".'
            )
        how = "however old they are (command.stamps is ignore)"
        if self._policy == "relative":
            how = "their age judged against each other"
        return (
            f"Its commands are obeyed, {how}, but its transforms and ours do not fit: synchronise "
            "the clocks."
        )
