"""Counts to speeds.

Law: a speed is counts over whole time on the board, over the shortest window that shows it. One
count in 10 ms is already 16 mm/s: slow motion needs a longer window than fast motion. It grows
backwards until the busiest motor has 32 counts in it, or it is 100 ms long. The speed belongs to
the middle of the window.

If the time of sampling is unknown, counts are taken over the longest time that they can have
needed, and ``unsure_ns`` is how much shorter it may have been. No window begins there.

If times of sampling have an error, ``rough_ns`` is that of the window's length: the speed is as
uncertain as it.
"""

from __future__ import annotations

import math

import msgspec

from yahboomd.core.counts import CountHistory
from yahboomd.core.model import Kinematics, Motor, Twist2d
from yahboomd.core.odometry.factors import motor_factors

SHORTEST_NS = 20_000_000
"""The shortest window, where readings allow."""

LONGEST_NS = 100_000_000
"""The longest window, unless readings lie farther apart."""

ENOUGH_TICKS = 32
"""A window with this many counts of the busiest motor need not grow."""

ASKED_TICKS = 3.5
"""The unseen ticks that a window must span (four, if the board is asked every two): one more or
less is then a quarter of the speed; over two of them it would be half."""

STILL_DEVIATIONS = 6
"""If times are rough, wheels stand only if the counters stay for more than these deviations."""


class Window(msgspec.Struct, frozen=True):
    """The time over which speeds were measured.

    Attributes:
        span_ns: Its length; 0 before there are two readings.
        deltas: Signed counts of each motor in it.
        unsure_ns: How much shorter it may have been.
        rough_ns: Standard deviation of its length.
    """

    span_ns: int
    deltas: tuple[int, ...]
    unsure_ns: int = 0
    rough_ns: int = 0


class VelocityEstimator:
    """Speeds of the motors and of the body.

    Attributes:
        rough_ns: Standard deviation of the time of each reading, if it matters; the window is then
            the longest.
        doubt: The share by which every time may be wrong (standard deviation).
        tick_ns: The period at which the board renews its counters, if readings do not show when:
            over a time that is not whole ticks, counts are those of one tick more or less.
    """

    __slots__ = (
        "_factors _metres _zero _history _time_ns _kept _began rough_ns doubt tick_ns"
    ).split()

    def __init__(self, kinematics: Kinematics, motors: tuple[Motor, ...]) -> None:
        self._factors = motor_factors(kinematics, motors)
        self._metres = tuple(motor.metres_per_tick for motor in motors)
        self._zero = (0,) * len(motors)
        self._history = CountHistory(LONGEST_NS)
        self._time_ns = 0
        self._kept = True
        self._began = (0, 0)
        self.rough_ns = 0
        self.doubt = 0.0
        self.tick_ns = 0

    def interrupt(self, totals: tuple[int, ...] | None, rough_ns: int = 0) -> None:
        """Start again from a reading that does not continue the one before.

        Args:
            totals: Its totals; None if its time is unknown, so that no speed begins there.
            rough_ns: Standard deviation of its time, against those of the readings that follow.
        """
        self._began = (self._time_ns, rough_ns)
        self._history.clear()
        if totals is not None:
            self._history.add(self._time_ns, totals)

    def take_back(self) -> None:
        if self._kept:
            self._history.drop_latest()

    def stand(self, totals: tuple[int, ...], step_ns: int) -> None:
        self._time_ns += step_ns
        self._history.add(self._time_ns, totals)
        self._kept = True

    def measure(self, totals: tuple[int, ...], step_ns: int, unsure_ns: int = 0) -> Window:
        """Take in the totals after a step on the board's clock.

        Args:
            step_ns: Duration of the step; the longest possible, if it is unknown.
            unsure_ns: How much shorter it may have been.
        """
        history = self._history
        self._time_ns += step_ns
        history.add(self._time_ns, totals)
        self._kept = not unsure_ns
        if unsure_ns:
            found = history.since()
            history.drop_latest()
        else:
            enough = math.inf if self.rough_ns else ENOUGH_TICKS
            shortest_ns = max(SHORTEST_NS, round(ASKED_TICKS * self.tick_ns))
            found = history.since(shortest_ns, LONGEST_NS, enough)
        if found is None or self._too_soon(*found):
            return Window(0, self._zero)
        return Window(*found, unsure_ns, self._rough_ns(found[0]))

    def _too_soon(self, span_ns: int, deltas: tuple[int, ...]) -> bool:
        """Whether unchanged counters may not have been renewed since the window began."""
        began_ns, began_rough_ns = self._began
        return (
            span_ns < STILL_DEVIATIONS * began_rough_ns
            and self._time_ns - span_ns == began_ns
            and not any(deltas)
        )

    def _rough_ns(self, span_ns: int) -> int:
        """Standard deviation of the length of a window that ends now."""
        part_ns = span_ns % self.tick_ns if self.tick_ns else 0
        began_ns, began_rough_ns = self._began
        # A tick more with the probability of its part, else a tick less: p (1 - p) ticks squared.
        variance = part_ns * (self.tick_ns - part_ns) + self.rough_ns**2
        if self._time_ns - span_ns == began_ns:
            variance += began_rough_ns**2
        return round(math.sqrt(variance + (self.doubt * span_ns) ** 2))

    def motor_speeds(self, window: Window) -> tuple[float, ...]:
        """Rim speed of each motor in m/s, positive forward."""
        if not window.span_ns:
            return (0.0,) * len(self._metres)
        per_second = 1e9 / window.span_ns
        return tuple(
            [
                metres * delta * per_second
                for metres, delta in zip(self._metres, window.deltas, strict=True)
            ]
        )

    def twist(self, window: Window) -> Twist2d:
        if not window.span_ns:
            return Twist2d()
        per_second = 1e9 / window.span_ns
        x = y = turn = 0.0
        for (along, across, turning), delta in zip(self._factors, window.deltas, strict=True):
            x += along * delta
            y += across * delta
            turn += turning * delta
        return Twist2d(vx=x * per_second, vy=y * per_second, wz=turn * per_second)
