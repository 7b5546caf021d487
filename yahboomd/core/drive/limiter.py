"""The limits of motion for each axis: velocity, acceleration, deceleration and jerk.

One law: **each step ends between its start and the wish**, never beyond, never away. So a
wish for less speed never speeds up first, a ramp to zero cannot swing through it, and the last
value is the wish itself.

The limits are those of control_toolbox: jerk, acceleration and velocity, symmetric in both
directions, and deceleration while the magnitude of the speed falls. Its plain clamp of the second
difference overshoots, because reducing a built-up acceleration takes time. Here the velocity is
clamped first, and with a jerk limit the acceleration stays small enough to be reduced to zero
before the wish is reached: ``a dt + a^2 / (2 j) <= distance``. That condition also holds for later
steps of any length. If the wish changes so that it can no longer be met (a stop in the middle of
speeding up), the jerk limit gives way, not the law: an acceleration away from the wish is dropped
at once, and one that is too large to be reduced in time ends at the wish.
"""

from __future__ import annotations

import math

import msgspec

from yahboomd.core.model import STANDSTILL, Twist2d

_NO_LIMIT = 1e9
"""A larger wish is cut to this, so that the sums of the ramp stay finite."""


class AxisCaps(msgspec.Struct, frozen=True, kw_only=True):
    """Limits of one axis; ``None`` is unlimited. In m and s, or rad and s.

    Attributes:
        velocity: The largest speed, either way; 0 keeps the axis still.
        acceleration: The largest rate while the magnitude of the speed grows.
        deceleration: The largest rate while it falls.
        jerk: The largest change of the rate, per second.
    """

    velocity: float | None = None
    acceleration: float | None = None
    deceleration: float | None = None
    jerk: float | None = None


class Limiter:
    """Limits a command on each axis, and remembers the latest velocity and acceleration.

    Args:
        linear: Limits of ``vx`` and of ``vy``, each by itself.
        angular: Limits of ``wz``.
        longest_step_s: The most time that one step accounts for. During a pause the wheels did not
            accelerate: without this bound, the first command after ten idle seconds would pass
            without a ramp.
    """

    def __init__(self, linear: AxisCaps, angular: AxisCaps, *, longest_step_s: float = 0.1) -> None:
        self._longest_step_s = longest_step_s
        self._vx = _Axis(linear)
        self._vy = _Axis(linear)
        self._wz = _Axis(angular)

    @property
    def current(self) -> Twist2d:
        return Twist2d(vx=self._vx.speed, vy=self._vy.speed, wz=self._wz.speed)

    def limit(self, wanted: Twist2d, dt_s: float) -> Twist2d:
        """Move towards ``wanted`` for ``dt_s`` seconds; returns the velocity at the end.

        Args:
            wanted: The wish; a number in it that is not finite counts as zero.
            dt_s: Time since the last step. Zero or less changes nothing.
        """
        if dt_s > 0.0:
            dt_s = min(dt_s, self._longest_step_s)
            self._vx.approach(wanted.vx, dt_s)
            self._vy.approach(wanted.vy, dt_s)
            self._wz.approach(wanted.wz, dt_s)
        return self.current

    def clips(self, wanted: Twist2d) -> bool:
        return self._vx.clips(wanted.vx) or self._vy.clips(wanted.vy) or self._wz.clips(wanted.wz)

    def halt(self) -> Twist2d:
        """Set the velocity to zero at once, past all limits: for every stop that may not ramp."""
        return self.reset(STANDSTILL)

    @property
    def halted(self) -> bool:
        return self._vx.speed == self._vy.speed == self._wz.speed == 0.0

    def reset(self, twist: Twist2d) -> Twist2d:
        """Continue from ``twist``, the velocity that was really sent, without acceleration."""
        self._vx.reset(twist.vx)
        self._vy.reset(twist.vy)
        self._wz.reset(twist.wz)
        return twist


class _Axis:
    def __init__(self, limits: AxisCaps) -> None:
        self._velocity = min(_NO_LIMIT, _limit(limits.velocity))
        self._acceleration = _limit(limits.acceleration)
        self._deceleration = _limit(limits.deceleration)
        self._jerk = _limit(limits.jerk)
        self.speed = 0.0
        self._rate = 0.0

    def reset(self, speed: float) -> None:
        self.speed = speed
        self._rate = 0.0

    def clips(self, wish: float) -> bool:
        return abs(wish) > self._velocity

    def approach(self, wish: float, dt_s: float) -> None:
        if not math.isfinite(wish):
            wish = 0.0
        wish = max(-self._velocity, min(self._velocity, wish))
        if wish == self.speed:
            self._rate = 0.0
        elif self._jerk == math.inf:
            self.speed = self._ramp(wish, dt_s)
        else:
            self._smooth(wish, dt_s)

    def _ramp(self, wish: float, dt_s: float) -> float:
        speed = self.speed
        if _must_cross_zero(speed, wish):
            to_zero_s = abs(speed) / self._deceleration
            if to_zero_s >= dt_s:
                return math.copysign(max(0.0, abs(speed) - self._deceleration * dt_s), speed)
            # The rest of the step belongs to the other direction.
            dt_s -= to_zero_s
            speed = 0.0
        if abs(wish) < abs(speed):
            return math.copysign(max(abs(wish), abs(speed) - self._deceleration * dt_s), speed)
        return math.copysign(min(abs(wish), abs(speed) + self._acceleration * dt_s), wish)

    def _smooth(self, wish: float, dt_s: float) -> None:
        # A change of direction passes through standstill, so that the two rates need not agree.
        goal = 0.0 if _must_cross_zero(self.speed, wish) else wish
        distance = abs(goal - self.speed)
        towards = math.copysign(1.0, goal - self.speed)
        most = self._deceleration if abs(goal) < abs(self.speed) else self._acceleration
        rate = max(0.0, self._rate * towards)
        change = self._jerk * dt_s
        landing = distance / dt_s
        if landing > min(most, change):
            # The largest rate that can still be taken back: a dt + a^2 / (2 j) = distance.
            safe = 2.0 * distance / (dt_s + math.sqrt(dt_s * dt_s + 2.0 * distance / self._jerk))
            rate = min(max(min(safe, rate + change), rate - change), most, landing)
            if rate < landing:
                self.speed += towards * rate * dt_s
                self._rate = towards * rate
                return
        # The goal is one step away, and the rate can be zero in the step after.
        self.speed = goal
        self._rate = 0.0


def _must_cross_zero(speed: float, wish: float) -> bool:
    return speed > 0.0 >= wish or speed < 0.0 <= wish


def _limit(value: float | None) -> float:
    return math.inf if value is None else value
