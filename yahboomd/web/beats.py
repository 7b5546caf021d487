"""The server's beats, which show the age of a page's command.

Every command carries the last beat that its page received. A beat's age is the time since it was
made, and includes every delay: here, on the way to the page, in the page, and on the way back. So a
command from a queue is as old as the beat in it.
"""

from __future__ import annotations

import secrets
from collections import deque

from yahboomd.core.clock import Clock

PERIOD_NS = 50_000_000

LAPSE_NS = 300_000_000
"""A command whose beat is older is refused, and a page that drives and is silent for this time is
stopped."""

KEPT = 200
"""Ten seconds; older beats are unknown."""


class Beats:
    """Counts beats, and knows when each was made.

    Args:
        clock: Measures their age. The time that the machine was suspended counts too.
    """

    def __init__(self, clock: Clock) -> None:
        # A random start: beats of another server, or from before a restart, are not valid here.
        self.latest = secrets.randbelow(1 << 40)
        self._clock = clock
        self._made_ns: deque[int] = deque(maxlen=KEPT)

    def beat(self) -> int:
        """Make the next one."""
        self.latest += 1
        self._made_ns.append(self._now_ns())
        return self.latest

    def age_ns(self, beat: int, joined: int) -> int | None:
        """The age of a beat; None if the page cannot have received it.

        Args:
            beat: As the page sent it.
            joined: The latest beat when the page connected.
        """
        behind = self.latest - beat
        if beat <= joined or not 0 <= behind < len(self._made_ns):
            return None
        return self._now_ns() - self._made_ns[-1 - behind]

    def _now_ns(self) -> int:
        return self._clock.now_ns() + self._clock.suspended_ns()
