"""How sure the pose and the twist are.

Law: what is not known grows and never shrinks by itself. Every wheel's travel is wrong by a random
amount whose variance is proportional to the distance it rolled; every count is known to a tick.
Both go through the Jacobians of the very step that was integrated, so the volume of the pose's
covariance (its determinant) and the variance of its heading never fall; single entries may, because
an error of heading that pushed the robot sideways on its way out pulls it back on its way home.

First-order propagation as in Siegwart, Nourbakhsh and Scaramuzza, *Autonomous Mobile Robots*,
section 5.2.4 (variance proportional to the wheels' travel: equation 5.8), with the exact arc in
place of the midpoint.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from yahboomd.model import Kinematics, Matrix3, Motor
from yahboomd.odometry.factors import MotorFactors, motor_factors
from yahboomd.odometry.integrator import Arc
from yahboomd.odometry.velocity import Window

NOISE_M = 1e-5
"""Variance of a wheel's travel per metre rolled, in m: 3 mm after 1 m. Hard floor, no slip."""

SIDEWAYS_M_S = 1e-3
"""Standard deviation of the sideways speed of a base that cannot move sideways."""

TURN_VARIANCE_MAX = math.pi * math.pi / 3.0
"""A heading of which nothing at all is known: evenly spread over the circle."""

Six = tuple[float, float, float, float, float, float]
"""The upper triangle of a symmetric 3 by 3 matrix: xx, xy, xt, yy, yt, tt."""


def _outer(factors: MotorFactors, weight: float) -> Six:
    x, y, turn = factors
    return (
        weight * x * x,
        weight * x * y,
        weight * x * turn,
        weight * y * y,
        weight * y * turn,
        weight * turn * turn,
    )


def _full(six: Six) -> Matrix3:
    xx, xy, xt, yy, yt, tt = six
    return (xx, xy, xt, xy, yy, yt, xt, yt, tt)


class Covariance:
    """Covariance of the pose over (x, y, theta), and of the twist over (vx, vy, wz).

    Args:
        kinematics: The geometry of the base.
        motors: The motors, in the order in which counts are handed in.
        noise_m: Variance of a wheel's travel per metre that it rolls.
    """

    def __init__(
        self, kinematics: Kinematics, motors: tuple[Motor, ...], *, noise_m: float = NOISE_M
    ) -> None:
        factors = motor_factors(kinematics, motors)
        sharing = [sum(other.wheel == motor.wheel for other in motors) for motor in motors]
        # A wheel's factors are its motor's times the number of motors on it. Motors of one side
        # slip together, so a side has one noise, from the mean distance of its motors.
        self._per_tick = tuple(
            _outer(one, noise_m / motor.metres_per_tick * count)
            for one, motor, count in zip(factors, motors, sharing, strict=True)
        )
        # A difference of two counters is off by the difference of two even spreads over a tick,
        # whose variance is 1/6.
        self._tick = tuple(_outer(one, 1.0 / 6.0) for one in factors)
        self._floor: Six = tuple(map(sum, zip(*self._tick, strict=True)))  # type: ignore[assignment]
        self._sideways = 0.0 if kinematics.holonomic else SIDEWAYS_M_S**2
        self._turn_per_metre = sum(
            (kinematics.forward[2][wheel]) ** 2 for wheel in range(len(kinematics.wheels))
        )
        self._six: Six = (0.0,) * 6
        self.set_pose(0.0)

    @property
    def pose(self) -> Matrix3:
        """Covariance of the pose, row by row."""
        return _full(self._six)

    def set_pose(self, theta: float, covariance: Matrix3 | None = None) -> None:
        """Start anew from a given pose.

        The counters' own resolution is added: the baseline is known to a tick only.

        Args:
            theta: The heading of that pose, radians.
            covariance: How sure it is; None for sure.
        """
        cos, sin = math.cos(theta), math.sin(theta)
        xx, xy, xt, yy, yt, tt = self._floor
        yy = max(yy, xx)  # sideways a base is no better known than forward
        xx, xy, yy = (
            cos * cos * xx - 2.0 * cos * sin * xy + sin * sin * yy,
            cos * sin * (xx - yy) + (cos * cos - sin * sin) * xy,
            sin * sin * xx + 2.0 * cos * sin * xy + cos * cos * yy,
        )
        xt, yt = cos * xt - sin * yt, sin * xt + cos * yt
        if covariance is not None:
            # Half of each side: what is handed in may be symmetric only to rounding.
            xx, yy, tt = xx + covariance[0], yy + covariance[4], tt + covariance[8]
            xy += 0.5 * (covariance[1] + covariance[3])
            xt += 0.5 * (covariance[2] + covariance[6])
            yt += 0.5 * (covariance[5] + covariance[7])
        self._six = (xx, xy, xt, yy, yt, tt)

    def step(self, deltas: Sequence[int], arc: Arc) -> None:
        """Grow by one step: the counts of each motor and the arc that they made."""
        nxx = nxy = nxt = nyy = nyt = ntt = 0.0
        for (axx, axy, axt, ayy, ayt, att), delta in zip(self._per_tick, deltas, strict=True):
            if delta:
                distance = delta if delta > 0 else -delta
                nxx += axx * distance
                nxy += axy * distance
                nxt += axt * distance
                nyy += ayy * distance
                nyt += ayt * distance
                ntt += att * distance
        if not ntt and not nxx:
            return
        dx, dy, cos, sin, turn = arc
        # The columns of the Jacobian over (travel forward, travel left, turn) are (cos, sin),
        # (-sin, cos) and the arm below: half the step turned left, and the change of sinc.
        arm_x = -0.5 * dy - turn * dx / 12.0
        arm_y = 0.5 * dx - turn * dy / 12.0
        px = cos * nxx - sin * nxy + arm_x * nxt
        py = cos * nxy - sin * nyy + arm_x * nyt
        pt = cos * nxt - sin * nyt + arm_x * ntt
        qx = sin * nxx + cos * nxy + arm_y * nxt
        qy = sin * nxy + cos * nyy + arm_y * nyt
        qt = sin * nxt + cos * nyt + arm_y * ntt
        xx, xy, xt, yy, yt, tt = self._six
        self._six = (
            xx - 2.0 * dy * xt + dy * dy * tt + cos * px - sin * py + arm_x * pt,
            xy + dx * xt - dy * yt - dx * dy * tt + sin * px + cos * py + arm_y * pt,
            xt - dy * tt + pt,
            yy + 2.0 * dx * yt + dx * dx * tt + sin * qx + cos * qy + arm_y * qt,
            yt + dx * tt + qt,
            tt + ntt,
        )

    def lose(self, travel_m: float) -> None:
        """Grow by travel that was not counted.

        Args:
            travel_m: Every wheel may have rolled up to so far, either way, in any order.
        """
        variance = travel_m * travel_m / 3.0
        xx, xy, xt, yy, yt, tt = self._six
        turn = min(self._turn_per_metre * variance, TURN_VARIANCE_MAX)
        self._six = (xx + variance, xy, xt, yy + variance, yt, tt + turn)

    def bridge(self, arc: Arc) -> None:
        """Grow by the unknown order of what was counted while nobody looked.

        The counters tell how far the robot went and how far it turned, not which came first: the
        true end lies up to half the turn to either side of the arc's.
        """
        length = math.hypot(arc.dx, arc.dy)
        variance = (length * min(1.0, abs(arc.turn) / math.sqrt(12.0))) ** 2
        xx, xy, xt, yy, yt, tt = self._six
        self._six = (xx + variance, xy, xt, yy + variance, yt, tt)

    def twist(self, window: Window) -> Matrix3:
        """Covariance of the twist that was taken over a window, row by row."""
        if not window.span_ns:
            return (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
        xx, xy, xt, yy, yt, tt = self._floor
        for (axx, axy, axt, ayy, ayt, att), delta in zip(
            self._per_tick, window.deltas, strict=True
        ):
            if delta:
                distance = delta if delta > 0 else -delta
                xx += axx * distance
                xy += axy * distance
                xt += axt * distance
                yy += ayy * distance
                yt += ayt * distance
                tt += att * distance
        rate = (1e9 / window.span_ns) ** 2
        return (
            xx * rate,
            xy * rate,
            xt * rate,
            xy * rate,
            yy * rate + self._sideways,
            yt * rate,
            xt * rate,
            yt * rate,
            tt * rate,
        )
