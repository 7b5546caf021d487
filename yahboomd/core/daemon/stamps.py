"""Wall time for outgoing samples, from the monotonic moments that the core works with."""

from __future__ import annotations

from collections.abc import Callable

from yahboomd.core.clock import Clock, nanoseconds, seconds
from yahboomd.core.model import Event

STEP_S = 1.0
"""A wall clock that is off by more was set: time daemons slew a smaller difference, and step a
larger one (chrony: 1 s, by default)."""

SLEW = 10
"""A smaller difference is followed at a tenth of the pace: stamps stay in order and well apart."""


class WallStamps:
    """Turns monotonic nanoseconds into Unix ones that run backwards only if the clock was set.

    The wall clock may be set while the robot drives (a Raspberry Pi has none of its own and learns
    the time when the network comes). Forward it is followed at once. Backward it is followed
    slowly, without a stamp out of order; but by :data:`STEP_S` and more at once, because everything
    else on this machine lives in the new time (decision 0020). Steps are reported.

    The two clocks cannot be read at once. A process that is held up between them would take the
    delay for a step of the wall clock; so the monotonic one is read before and after, and the
    earlier difference stays in force unless these three readings exclude it.

    Attributes:
        held_back: Stamps that came 1 ns after the one before, to stay in order.
        steps: How often the wall clock was set by :data:`STEP_S` and more.
    """

    def __init__(self, clock: Clock, publish: Callable[[Event], None]) -> None:
        self._clock = clock
        self._publish = publish
        self._last_ns = 0
        self._offset_ns: int | None = None
        self._followed_ns = 0
        self._suspended_ns = 0
        self.held_back = 0
        self.steps = 0

    def of(self, monotonic_ns: int) -> int:
        stamp_ns = monotonic_ns + self.follow()
        if stamp_ns <= self._last_ns:
            self.held_back += 1
            stamp_ns = self._last_ns + 1
        self._last_ns = stamp_ns
        return stamp_ns

    def follow(self) -> int:
        """Read the wall clock. Returns wall time less monotonic time, as stamps have it."""
        before_ns = self._clock.now_ns()
        wall_ns = self._clock.wall_ns()
        after_ns = self._clock.now_ns()
        suspended_ns = self._clock.suspended_ns()
        least, most = wall_ns - after_ns, wall_ns - before_ns
        offset_ns = most if self._offset_ns is None else self._offset_ns
        change_ns = min(max(offset_ns, least), most) - offset_ns
        # Monotonic time stands still in a suspend, and wall time does not: that is no step.
        step_ns = change_ns - max(0, suspended_ns - self._suspended_ns)
        stepped = abs(step_ns) >= nanoseconds(STEP_S) and self._offset_ns is not None
        if change_ns < 0 and not stepped:
            change_ns = max(change_ns, (self._followed_ns - after_ns) // SLEW)
        elif stepped and change_ns < 0:
            self._last_ns = 0
        self._offset_ns = offset_ns = offset_ns + change_ns
        self._followed_ns, self._suspended_ns = after_ns, suspended_ns
        if stepped:
            self.steps += 1
            self._publish(_event(step_ns))
        return offset_ns

    def now(self) -> int:
        """The Unix time now, for samples that are no readings; not held back."""
        return self._clock.wall_ns()


def _event(step_ns: int) -> Event:
    by_s = seconds(step_ns)
    where = "forward" if step_ns > 0 else "back"
    words = f"This machine's clock was set {where} by {abs(by_s):.1f} s, and stamps follow it."
    if step_ns < 0:
        words += (
            " They ran backwards once: restart programs that drop samples older than their newest "
            "one, such as listeners of tf2 that started before."
        )
    return Event(
        kind="clock_stepped",
        severity="info" if step_ns > 0 else "warning",
        message=words,
        data={"by_s": round(by_s, 3)},
    )
