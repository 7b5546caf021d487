"""Interruptions of the control path: a pause of this process, or a reset of the board.

The process may have been stopped by a signal, frozen by its cgroup, starved of processor time, or
the whole machine was suspended. The board drove on and sent counts; clients went on to command. All
of it arrives at once afterwards, and looks new.

A board announces its reset, or its counters show it. Its motors are free then, its command is lost.
"""

from __future__ import annotations

from yahboomd.core.clock import PAUSE_NS, Clock, Pause, PauseWatch
from yahboomd.core.daemon.publisher import Events, Outputs
from yahboomd.core.daemon.wheels import Wheels
from yahboomd.core.drive.arbiter import Arbiter
from yahboomd.core.drive.holds import FAULT, Holds, ResetWatch
from yahboomd.core.drive.limiter import Limiter
from yahboomd.core.link.port_guard import PortGuard
from yahboomd.core.model import Counts, Event

WAITED_NS = 100_000_000
"""The time after a pause in which waiting commands arrive. Measured with clients of Zenoh that sent
20 to 200 commands a second to a process stopped for 0.6 to 9 s: the last came 42 ms after it."""

PROMISED_NS = 500_000_000
"""The guard stops the wheels if no control step comes for this time."""

GUARD_STOPPED = " Its guard stopped the wheels."

LATEST_WAITED_NS = 10_000_000_000
"""Over a network a suspended machine gets retransmissions for up to the time that it was away;
after 10 s, the lease of Zenoh's sessions, its neighbours have given up."""


class Pauses:
    """Detects pauses, and discards commands and counts that waited for their end.

    Args:
        period_ns: How often the control path runs at least.
        arbiter: Refuses commands that may have waited.
        wheels: Judge no counts that waited.
        limiter: Begins again from standstill if the guard stopped the wheels.
        guard: Its stops are pauses, too.
    """

    def __init__(
        self,
        clock: Clock,
        period_ns: int,
        *,
        arbiter: Arbiter,
        wheels: Wheels,
        limiter: Limiter,
        events: Events,
        guard: PortGuard,
    ) -> None:
        self._clock = clock
        self._watch = PauseWatch(clock, PAUSE_NS + period_ns)
        self._arbiter = arbiter
        self._wheels = wheels
        self._limiter = limiter
        self._guard = guard
        self._stops = guard.stops
        self._events = events
        self._waited_ns = 0

    def notice(self) -> bool:
        """Whether a pause ended just now; call it before using anything that may have waited."""
        pause, stops = self._watch.detect(), self._guard.stops
        stopped, self._stops = stops != self._stops, stops
        if pause is None:
            if not stopped:
                return False
            # Control steps were late, though others were not.
            now_ns = self._clock.now_ns()
            pause = Pause(since_ns=now_ns - PROMISED_NS, until_ns=now_ns, suspended_ns=0)
        self._arbiter.paused(
            pause.since_ns,
            pause.until_ns,
            waited_ns=min(max(WAITED_NS, pause.suspended_ns), LATEST_WAITED_NS),
            clock_stood=pause.suspended_ns > 0,
        )
        self._wheels.paused(pause.until_ns)
        if stopped:
            self._limiter.halt()
            self._wheels.stopped_by_guard(pause.until_ns)
        self._waited_ns = pause.until_ns + WAITED_NS
        self._events.report(
            Event(
                kind="paused",
                severity="warning",
                message=(
                    f"yahboomd did not run for {pause.duration_s:.1f} s (stopped, frozen, starved "
                    "or suspended): commands that waited are discarded, unless a stamp shows "
                    f"that they are new.{GUARD_STOPPED if stopped else ''}"
                ),
                data={"duration_s": round(pause.duration_s, 3)},
            )
        )
        return True

    def just_ended(self, now_ns: int) -> bool:
        """Whether data that arrives now may have waited for the end of a pause."""
        return now_ns < self._waited_ns


class Resets:
    """Handles resets of the board for the control path.

    Args:
        wheels: Are released, and commanded again.
        limiter: Begins again from standstill.
        holds: Gets the hold after a reset, and the fault after too many.
    """

    def __init__(
        self,
        clock: Clock,
        *,
        wheels: Wheels,
        limiter: Limiter,
        holds: Holds,
        events: Events,
        outputs: Outputs,
    ) -> None:
        self._clock = clock
        self._wheels = wheels
        self._limiter = limiter
        self._holds = holds
        self._events = events
        self._outputs = outputs
        self._watch = ResetWatch()

    def interrupted(
        self,
        event: Event,
        ticks: Counts,
        before: Counts,
        *,
        paused: bool = False,
        silent_s: float = 0.0,
    ) -> None:
        """Check for a reset: a break in the counts may be its only sign.

        Args:
            event: The odometer's event about them.
            ticks: The board's counters now.
            before: The board's counters before.
            paused: This process did not run meanwhile, which explains a gap without a reset.
            silent_s: The shortest silence after a reset: a shorter gap is no reset.
        """
        data = event.data or {}
        cause = data.get("cause")
        # After a silence the odometer cannot count from zero, although the counters did.
        fell = max(map(abs, ticks)) < max(map(abs, before))
        gap_s = data.get("gap_s")
        may_be = not paused and isinstance(gap_s, float) and gap_s >= silent_s
        gap_by_reset = cause == "gap_lost" and fell and self._wheels.in_motion and may_be
        if cause == "reset_unseen" or gap_by_reset:
            if self._wheels.noisy:
                # Lost digits look the same: they must not add up to a loop.
                self._watch.clear()
            self.restarted("The board reset itself without its start message")
        unmoved = cause == "gap_kept" and not data.get("counted_m")
        if unmoved or cause in {"reset_unseen", "gap_lost", "rebased"}:
            # A board that was not sent its motors' type turns no wheel: that they stood until now
            # is no fault of theirs.
            self._wheels.check.reset()
            self._wheels.rearm()

    def restarted(self, what: str) -> None:
        now_ns = self._clock.now_ns()
        in_motion = self._wheels.in_motion
        self._limiter.halt()
        self._wheels.release(now_ns)
        self._wheels.check.reset()
        words = what + (
            " in motion: its motors are free, and it stands a second before it may drive again."
            if in_motion
            else "."
        )
        self._events.report(Event(kind="board_reset", severity="warning", message=words))
        hold = self._watch.reset(now_ns, in_motion=in_motion)
        if hold is not None:
            self._holds.add(hold)
            if hold.kind == FAULT:
                self._events.report(
                    Event(kind="reset_loop", severity="error", message=hold.message)
                )
        self._outputs.changed()

    def clear(self) -> None:
        """Clear past resets, after a person looked into them."""
        self._watch.clear()
