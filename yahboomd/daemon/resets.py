"""A board that restarts: how that is noticed, and what follows.

It announces it, or its counters show it. Its motors are free then, and its command is lost.
"""

from __future__ import annotations

from yahboomd.clock import Clock
from yahboomd.daemon.outputs import Events, Outputs
from yahboomd.daemon.wheels import Wheels
from yahboomd.drive.holds import FAULT, Holds, ResetWatch
from yahboomd.drive.limiter import Limiter
from yahboomd.model import Counts, Event


class Resets:
    """What the control path does about resets of the board.

    Args:
        clock: What tells the time.
        wheels: Are let go, and commanded again.
        limiter: Begins again from standstill.
        holds: Where the rest after a reset is put, and the fault after too many.
        events: Tell of it.
        outputs: Hear that the state may have changed.
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

    def announced(self, version: str) -> None:
        """The board announced a restart."""
        self._started_anew(f"The board reset itself (firmware {version})")

    def interrupted(
        self, event: Event, ticks: Counts, before: Counts, *, paused: bool = False
    ) -> None:
        """Counts that do not go on may be all that is seen of a reset.

        Args:
            event: What the odometer says of them.
            ticks: What the board counts now.
            before: What it counted last.
            paused: This process did not run meanwhile, which explains a gap without a reset.
        """
        cause = (event.data or {}).get("cause")
        # After a silence the odometer cannot count from zero, but zero is where they came from.
        fell = max(map(abs, ticks)) < max(map(abs, before))
        gap_by_reset = cause == "gap_lost" and fell and self._wheels.in_motion and not paused
        if cause == "reset_unseen" or gap_by_reset:
            if self._wheels.noisy:
                # Digits that were lost on their way look the same: they do not add up to a loop.
                self._watch.clear()
            self._started_anew("The board reset itself without a word")
        if cause in {"reset_unseen", "gap_lost", "rebased"}:
            # A polled board without its motors' type turns no wheel; what the wheels did
            # not do until now is no fault of theirs.
            self._wheels.forget()
            self._wheels.rearm()

    def _started_anew(self, what: str) -> None:
        now_ns = self._clock.now_ns()
        in_motion = self._wheels.in_motion
        self._limiter.halt()
        self._wheels.release(now_ns)
        self._wheels.forget()
        words = what + (
            " in motion: its motors are free, and it stands a second before it may drive again."
            if in_motion
            else "."
        )
        self._events.tell(Event(kind="board_reset", severity="warning", message=words))
        hold = self._watch.reset(now_ns, in_motion=in_motion)
        if hold is not None:
            self._holds.put(hold)
            if hold.kind == FAULT:
                self._events.tell(Event(kind="reset_loop", severity="error", message=hold.message))
        self._outputs.changed()

    def clear(self) -> None:
        """Forget past resets, after a person looked into them."""
        self._watch.clear()
