"""Wall time for outgoing samples, from the monotonic moments that the core works with."""

from __future__ import annotations

from yahboomd.clock import Clock


class WallStamps:
    """Turns monotonic nanoseconds into Unix ones that never run backwards.

    The wall clock may be set while the robot drives (a Raspberry Pi has none of its own and learns
    the time when the network comes). Forward it is followed; backward the stamps creep on by a
    nanosecond until it has caught up, and the wait is counted.

    The two clocks cannot be read at once. Whoever is held up between them would take the delay for
    a step of the wall clock; so the monotonic one is read before and after, and what the clocks
    were apart before goes on to hold unless it lies outside what these three readings allow.

    Args:
        clock: What tells both times.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._last_ns = 0
        self._offset_ns: int | None = None
        self.held_back = 0

    def of(self, monotonic_ns: int) -> int:
        """The Unix time of a moment on the monotonic clock."""
        stamp_ns = monotonic_ns + self._offset()
        if stamp_ns <= self._last_ns:
            self.held_back += 1
            stamp_ns = self._last_ns + 1
        self._last_ns = stamp_ns
        return stamp_ns

    def _offset(self) -> int:
        """Wall time less monotonic time."""
        before_ns = self._clock.now_ns()
        wall_ns = self._clock.wall_ns()
        least, most = wall_ns - self._clock.now_ns(), wall_ns - before_ns
        offset_ns = self._offset_ns
        if offset_ns is None:
            offset_ns = most
        self._offset_ns = offset_ns = min(max(offset_ns, least), most)
        return offset_ns

    def now(self) -> int:
        """The Unix time now, for samples that are no readings; not held back."""
        return self._clock.wall_ns()
