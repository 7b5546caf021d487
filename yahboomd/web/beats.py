"""The server's beats, by which the age of a page's command is known.

Every command carries the last beat that its page received. A beat is as old as the time since it
was made, wherever it was held up since: here, on the way to the page, in the page, or on the way
back. So a command from a queue is as old as the beat in it.
"""

from __future__ import annotations

import secrets
from collections import deque

from yahboomd.core.clock import Clock

PERIOD_NS = 50_000_000

LAPSE_NS = 300_000_000
"""A command whose beat is older is refused, and a page that drives and is silent so long is
stopped."""

KEPT = 200
"""Ten seconds; older beats are unknown."""


class Beats:
    """Counts beats, and knows when each was made.

    Args:
        clock: Measures their age. The time that the machine was suspended counts too.
    """

    def __init__(self, clock: Clock) -> None:
        # A page of another server's, or of this one before it was started again, knows no beat.
        self.latest = secrets.randbelow(1 << 40)
        self._clock = clock
        self._made_ns: deque[int] = deque(maxlen=KEPT)

    def beat(self) -> int:
        """Make the next one."""
        self.latest += 1
        self._made_ns.append(self._now_ns())
        return self.latest

    def age_ns(self, beat: int, joined: int) -> int | None:
        """The age of a beat; None where the page cannot have received it.

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
