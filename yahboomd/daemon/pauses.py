"""What the control path does about a time in which this process did not run.

It may have been stopped by a signal, frozen by its cgroup, starved of processor time, or the whole
machine was suspended. The board drove on meanwhile, and spoke; clients went on to command. All of
that comes in at once afterwards, and looks as if it were new.
"""

from __future__ import annotations

from yahboomd.clock import PAUSE_NS, Clock, PauseWatch
from yahboomd.daemon.outputs import Events
from yahboomd.daemon.wheels import Wheels
from yahboomd.drive.arbiter import Arbiter
from yahboomd.model import Event

WAITED_NS = 100_000_000
"""Commands that waited arrive for so long. Measured with clients of Zenoh that sent 20 to 200
commands a second to a process stopped for 0.6 to 9 s: the last came 42 ms after it went on."""

LATEST_WAITED_NS = 10_000_000_000
"""Over a network a suspended machine is sent things again after up to as long as it was away; after
10 s, the lease of Zenoh's sessions, its neighbours have given up."""


class Pauses:
    """Notices pauses, and lets nothing be believed that waited for their end.

    Args:
        clock: The source of time.
        period_ns: How often the control path runs at least.
        arbiter: Refuses commands that may have waited.
        wheels: Judge no counts that waited.
        events: Publish it.
    """

    def __init__(
        self, clock: Clock, period_ns: int, *, arbiter: Arbiter, wheels: Wheels, events: Events
    ) -> None:
        self._watch = PauseWatch(clock, PAUSE_NS + period_ns)
        self._arbiter = arbiter
        self._wheels = wheels
        self._events = events
        self._waited_ns = 0

    def notice(self) -> bool:
        """Whether a pause ended just now; called before anything that may have waited is used."""
        pause = self._watch.look()
        if pause is None:
            return False
        self._arbiter.paused(
            pause.since_ns,
            pause.until_ns,
            waited_ns=min(max(WAITED_NS, pause.suspended_ns), LATEST_WAITED_NS),
            clock_stood=pause.suspended_ns > 0,
        )
        self._wheels.paused(pause.until_ns)
        self._waited_ns = pause.until_ns + WAITED_NS
        self._events.tell(
            Event(
                kind="paused",
                severity="warning",
                message=(
                    f"yahboomd did not run for {pause.duration_s:.1f} s (stopped, frozen, starved "
                    "or suspended): commands that waited are discarded, unless a stamp shows "
                    "that they are new."
                ),
                data={"duration_s": round(pause.duration_s, 3)},
            )
        )
        return True

    def just_ended(self, now_ns: int) -> bool:
        """Whether what arrives now may have waited for the end of a pause."""
        return now_ns < self._waited_ns
