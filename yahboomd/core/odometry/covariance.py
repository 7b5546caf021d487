"""The covariance of the pose and of the twist.

Law: uncertainty grows and never shrinks by itself. Every wheel's travel has a random error whose
variance is proportional to the distance rolled; every count is exact to a tick. Both go through the
Jacobians of the step as it was integrated. The determinant of the pose's covariance and the
variance of its heading never fall; single entries may, because an error of heading that pushed the
robot sideways on its way out pulls it back on its way home.

The noise of one step is that of Siegwart, Nourbakhsh and Scaramuzza, *Autonomous Mobile Robots*,
section 5.2.4 (variance proportional to the wheels' travel: equation 5.8), with the exact arc in
place of the midpoint. The effect of an error of heading on the path is not linearised, because a
wandering heading shortens the path as well as bending it: 17 mm after 10 m straight ahead, more
than the wheels' own error. With the error of heading ``e`` (Gaussian, variance ``s``), of place
``w`` (a complex number, x + iy), a step's displacement ``d`` and its noise ``p``, ``n``::

    w' = w + (exp(ie) - 1) d + p        e' = e + n

and E exp(ike) = exp(-k*k*s/2), so that all second moments of w and e follow exactly, step by step,
from E w, E conj(w) (exp(ie) - 1) and E w (exp(ie) - 1), which are kept beside them. They are taken
about the published pose: the mean shortening is part of the error.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from yahboomd.core.model import Kinematics, Matrix3, Motor
from yahboomd.core.odometry.factors import MotorFactors, motor_factors
from yahboomd.core.odometry.integrator import Arc
from yahboomd.core.odometry.velocity import Window

NOISE_M = 1e-5
"""Variance of a wheel's travel per metre rolled, in m: 3 mm after 1 m. Hard floor, no slip."""

SIDEWAYS_M_S = 1e-3
"""Standard deviation of the sideways speed of a base that cannot move sideways."""

SHORTEST_SHARE = 0.05
"""A window of uncertain length is at least this share of its span."""

TURN_VARIANCE_MAX = math.pi * math.pi / 3.0
"""Variance of an unknown heading: evenly spread over the circle."""

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


def with_heading(covariance: Matrix3, variance: float) -> Matrix3:
    """The covariance over (x, y, heading) with another variance of the heading.

    The correlation of the heading with the place is kept.
    """
    xx, xy, xt, _, yy, yt, _, _, tt = covariance
    share = math.sqrt(variance / tt)
    xt, yt = share * xt, share * yt
    return (xx, xy, xt, xy, yy, yt, xt, yt, variance)


class Covariance:
    """Covariance of the pose over (x, y, theta), and of the twist over (vx, vy, wz).

    Args:
        motors: The motors, in the order of the counts.
        noise_m: Variance of a wheel's travel per metre that it rolls.

    Attributes:
        given: Variance of the heading when the pose was set, the counters' tick included.
    """

    __slots__ = (
        "_factors _per_tick _tick _floor _sideways _turn_per_metre _heading _ww _w2 _wt _tt "
        "given _mean _bent _bent_conjugate _volume"
    ).split()

    def __init__(
        self, kinematics: Kinematics, motors: tuple[Motor, ...], *, noise_m: float = NOISE_M
    ) -> None:
        self._factors = factors = motor_factors(kinematics, motors)
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
        self._heading: float | None = None
        self.set_pose(0.0)

    @property
    def tick_variance(self) -> float:
        """Variance of the heading from the ticks of the encoders, rad^2."""
        return self._floor[5]

    @property
    def gained(self) -> float:
        """Variance that the heading gained since the pose was set, rad^2."""
        return self._tt - self.given

    def turn(self, deltas: Sequence[int]) -> tuple[float, float, float]:
        """Convert counts to motion.

        Returns:
            The travel forward in metres, the turn in radians, and the turn's variance from the
            distance rolled, rad^2.
        """
        travel = turn = variance = 0.0
        for factors, weights, delta in zip(self._factors, self._per_tick, deltas, strict=True):
            travel += factors.x * delta
            turn += factors.turn * delta
            variance += weights[5] * abs(delta)
        return travel, turn, variance

    @property
    def pose(self) -> Matrix3:
        """Covariance of the pose about the published pose, row by row."""
        xt, yt = self._wt.real, self._wt.imag
        # If one is larger by orders of magnitude, rounding the sum may lose the other.
        least = self._floor[0]
        xx = max(least, 0.5 * (self._ww + self._w2.real))
        yy = max(least, 0.5 * (self._ww - self._w2.real))
        xy = 0.5 * self._w2.imag
        tt = self._tt
        pose = (xx, xy, xt, xy, yy, yt, xt, yt, tt)
        if self._heading is not None and self._heading < tt:
            # Later measurements of a gyro make the heading more certain than it was on the way.
            return with_heading(pose, self._heading)
        return pose

    def set_pose(self, theta: float, covariance: Matrix3 | None = None) -> None:
        """Restart from a given pose.

        The counters' own resolution is added: the baseline is exact only to a tick.

        Args:
            theta: The heading of that pose, radians.
            covariance: Its covariance; None if it is exact.
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
            # The mean of both halves: the argument may be symmetric only to rounding.
            xx, yy, tt = xx + covariance[0], yy + covariance[4], tt + covariance[8]
            xy += 0.5 * (covariance[1] + covariance[3])
            xt += 0.5 * (covariance[2] + covariance[6])
            yt += 0.5 * (covariance[5] + covariance[7])
        self._ww = xx + yy
        self._w2 = complex(xx - yy, 2.0 * xy)
        self._wt = complex(xt, yt)
        self._tt = tt
        self.given, self._heading = tt, None
        # Place and heading are taken as Gaussian together: E w exp(ie) = i E(w e) exp(-s/2).
        self._mean = 0j
        self._bent = 1j * math.exp(-0.5 * tt) * self._wt
        self._bent_conjugate = 1j * math.exp(-0.5 * tt) * self._wt.conjugate()
        self._volume = 0.0
        self._keep_volume()

    def propagate(self, deltas: Sequence[int], arc: Arc, fused: float | None = None) -> None:
        """Grow by one step.

        Args:
            fused: Variance that the heading of wheels and gyro gained since the pose was set; None
                without a gyro.
        """
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
        if fused is not None:
            self._heading = self.given + fused
            nxt = nyt = 0.0
            ntt = max(0.0, self._heading - self._tt)
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
        pxx = cos * px - sin * py + arm_x * pt
        pyy = sin * qx + cos * qy + arm_y * qt
        pxy = sin * px + cos * py + arm_y * pt
        tt = self._tt
        lost = -math.expm1(-0.5 * tt)  # of the way's length, at the mean
        kept = 1.0 - lost
        twice = kept * (1.0 + kept + kept * kept)
        fade = -math.expm1(-0.5 * ntt)
        stay = 1.0 - fade
        d = complex(dx, dy)
        c = complex(pt, qt)
        mean, bent, conjugate = self._mean, self._bent, self._bent_conjugate
        self._ww += 2.0 * (d * conjugate).real + 2.0 * (dx * dx + dy * dy) * lost + pxx + pyy
        self._w2 += 2.0 * d * bent + d * d * (lost * (1.0 - twice)) + complex(pxx - pyy, 2.0 * pxy)
        self._wt += 1j * d * (tt * kept) + c
        self._tt = tt + ntt
        turned = 1j * (stay * kept)
        self._bent = bent - fade * (bent + mean) + d * (lost * (1.0 - stay * twice)) + turned * c
        self._bent_conjugate = (
            conjugate
            - fade * (conjugate + mean.conjugate())
            + d.conjugate() * (lost * (1.0 + stay))
            + turned * c.conjugate()
        )
        self._mean = mean - d * lost
        self._keep_volume()

    def _keep_volume(self) -> None:
        """Keep the determinant from falling when the way back undoes the bend of the way out."""
        ww, w2, wt, tt = self._ww, self._w2, self._wt, self._tt
        along = (wt * wt.conjugate()).real
        # The determinant, from complex numbers.
        bent = (w2.conjugate() * wt * wt).real
        volume = 0.25 * tt * (ww * ww - (w2 * w2.conjugate()).real) - 0.5 * (ww * along - bent)
        short = self._volume - volume
        if short <= 0.0:
            self._volume = volume
        elif (slope := ww * tt - along) > 0.0:
            # Adding v to xx and yy raises the determinant by slope * v + tt * v * v.
            more = 2.0 * short / (slope + math.sqrt(slope * slope + 4.0 * tt * short))
            self._ww = ww + 2.0 * more

    def _add(self, place: float, turn: float) -> None:
        """Grow by errors that are independent of all earlier ones."""
        fade = -math.expm1(-0.5 * turn)
        self._ww += 2.0 * place
        self._tt += turn
        self._bent -= fade * (self._bent + self._mean)
        self._bent_conjugate -= fade * (self._bent_conjugate + self._mean.conjugate())
        self._keep_volume()

    def lose(self, travel_m: float) -> None:
        """Grow by travel that was not counted.

        Args:
            travel_m: The most that each wheel may have rolled, either way, in any order.
        """
        variance = travel_m * travel_m / 3.0
        self._add(variance, min(self._turn_per_metre * variance, TURN_VARIANCE_MAX))

    def bridge(self, arc: Arc) -> float:
        """Grow by the unknown order of motion within one long step.

        The counters show how far the robot went and how far it turned, not in which order: the
        true end lies up to half the turn to either side of the arc's end.

        Returns:
            The farthest that the true end may be from the arc's end, metres.
        """
        length = math.hypot(arc.dx, arc.dy)
        variance = (length * min(1.0, abs(arc.turn) / math.sqrt(12.0))) ** 2
        self._add(variance, 0.0)
        return length * min(2.0, 0.5 * abs(arc.turn))

    def twist(self, window: Window) -> Matrix3:
        """Covariance of the twist over a window, row by row."""
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
        if window.unsure_ns or window.rough_ns:
            return self._unsure_twist(window, (xx, xy, xt, yy, yt, tt))
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

    def _unsure_twist(self, window: Window, counts: Six) -> Matrix3:
        """The same for a window of uncertain length: every component scales with it."""
        span_ns = window.span_ns
        shortest_ns = max(span_ns - window.unsure_ns, SHORTEST_SHARE * span_ns)
        # The shortest window gives the largest speed: taken as two deviations.
        scale = 0.5 * (span_ns / shortest_ns - 1.0)
        scale = scale * scale + (window.rough_ns / span_ns) ** 2
        rate = (1e9 / shortest_ns) ** 2
        x = y = turn = 0.0
        for (along, across, turning), delta in zip(self._factors, window.deltas, strict=True):
            x += along * delta
            y += across * delta
            turn += turning * delta
        scale *= (1e9 / span_ns) ** 2
        xx, xy, xt, yy, yt, tt = counts
        xy = rate * xy + scale * x * y
        xt = rate * xt + scale * x * turn
        yt = rate * yt + scale * y * turn
        xx = rate * xx + scale * x * x
        yy = rate * yy + scale * y * y + self._sideways
        tt = rate * tt + scale * turn * turn
        return (xx, xy, xt, xy, yy, yt, xt, yt, tt)
