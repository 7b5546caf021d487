"""Counts to pose.

Law: heading comes from the integer totals, never from a sum of floats (except a gyro's
corrections); position advances by the exact arc of each step, plus the term that a changing
curvature adds.

Over one step with body travel ``u = (dx, dy)`` and turn ``φ`` at constant curvature, the
exponential map of SE(2) gives the displacement ``R(θ + φ/2) · sinc(φ/2) · u`` (Lynch and Park,
*Modern Robotics*, section 3.2.3; for ``dy = 0`` it is the arc of a differential drive). If the
curvature varies, the second term of the Magnus series adds ``-[ξ', ξ] h³/12`` to the exponent. With
the derivative taken from the step before (length ``h'``, travel ``u'``, turn ``φ'``) that is::

    u += 2h² / (h' (h + h')) / 12 · (φ' · J u - φ · J u')      J = a quarter turn to the left

which for equal steps of a differential drive is ``(φ' ds - φ ds') / 12`` sideways. It lifts the
order of the error from 2 to 3.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

from yahboomd.core.model import Kinematics, Motor, Pose2d
from yahboomd.core.odometry.factors import motor_factors

SERIES_BELOW = 1e-2
"""Below this the first three terms of the series are sin(x)/x to the last bit: x⁶/5040 < 2e-16."""

RATIO_MAX = 4
"""A step longer than this many times the one before is not corrected by it."""


def sinc(x: float) -> float:
    """sin(x)/x, with the series near zero, where the quotient is 0/0."""
    if -SERIES_BELOW < x < SERIES_BELOW:
        square = x * x
        return 1.0 - square / 6.0 * (1.0 - square / 20.0)
    return math.sin(x) / x


class Arc(NamedTuple):
    """One step as it was integrated, for the Jacobians of the covariance.

    Attributes:
        dx: Displacement in the odometry frame, metres.
        dy: The same, to the left.
        cos: Cosine of the heading in mid-step, times sinc of half the turn.
        sin: Sine, likewise.
        turn: The change of heading, radians.
    """

    dx: float
    dy: float
    cos: float
    sin: float
    turn: float


def arc_between(before: Pose2d, after: Pose2d) -> Arc:
    turn = after.theta - before.theta
    middle = before.theta + 0.5 * turn
    scale = sinc(0.5 * turn)
    cos, sin = scale * math.cos(middle), scale * math.sin(middle)
    return Arc(after.x - before.x, after.y - before.y, cos, sin, turn)


State: TypeAlias = tuple[float, float, float, float, tuple[float, float, float, int] | None]


class Doubt(NamedTuple):
    """A step that may turn out to have been a garbled reading.

    Attributes:
        state: State of the integrator before it.
        deltas: Its counts.
        step_ns: Its duration.
        correction: The turn that was added to that of the wheels.
    """

    state: State
    deltas: tuple[int, ...]
    step_ns: int
    correction: float = 0.0


class Integrator:
    """The pose, advanced by counts.

    Args:
        corrected: Whether varying curvature is corrected for; off only to compare.
    """

    __slots__ = (
        "_factors _corrected _zero _x _y _theta _theta_start _corrected_by _totals_start _before"
    ).split()

    def __init__(
        self, kinematics: Kinematics, motors: tuple[Motor, ...], *, corrected: bool = True
    ) -> None:
        self._factors = motor_factors(kinematics, motors)
        self._corrected = corrected
        self._zero = (0,) * len(motors)
        self._x = 0.0
        self._y = 0.0
        self._theta = 0.0
        self._theta_start = 0.0
        self._corrected_by = 0.0
        self._totals_start: tuple[int, ...] = self._zero
        self._before: tuple[float, float, float, int] | None = None

    @property
    def pose(self) -> Pose2d:
        """The pose of the base in the odometry frame; the heading is not wrapped."""
        return Pose2d(x=self._x, y=self._y, theta=self._theta)

    def set_pose(self, pose: Pose2d, totals: Sequence[int]) -> None:
        """Set the pose; ``totals`` are the counts that belong to it."""
        self._x, self._y, self._theta = pose.x, pose.y, pose.theta
        self._theta_start, self._corrected_by = pose.theta, 0.0
        self._totals_start = tuple(totals)

    def interrupt(self) -> None:
        """Discard the step before: the next one does not continue it."""
        self._before = None

    def stand(self, step_ns: int) -> None:
        self._before = (0.0, 0.0, 0.0, step_ns)

    def state(self) -> State:
        """A snapshot for :meth:`go_back`."""
        return self._x, self._y, self._theta, self._corrected_by, self._before

    def go_back(self, state: State) -> None:
        """Take back every step since; the totals that belong to the heading stay."""
        self._x, self._y, self._theta, self._corrected_by, self._before = state

    def integrate(
        self,
        deltas: Sequence[int],
        totals: Sequence[int],
        step_ns: int,
        correction: float = 0.0,
    ) -> Arc:
        """Advance by the counts of one step.

        Args:
            deltas: Signed counts of this step, per motor.
            totals: Signed counts since start, this step included.
            step_ns: How long the step took on the board; only its ratio to the step before counts.
            correction: The turn beyond that of the wheels, by a more certain sensor, radians.

        Returns:
            The displacement and its terms.
        """
        x = y = turn = heading = 0.0
        for factors, delta, total, start in zip(
            self._factors, deltas, totals, self._totals_start, strict=True
        ):
            along, across, turning = factors
            x += along * delta
            y += across * delta
            turn += turning * delta
            heading += turning * (total - start)
        turn += correction
        self._corrected_by += correction
        before = self._before
        self._before = (x, y, turn, step_ns)
        if before is not None and self._corrected:
            x0, y0, turn0, step0_ns = before
            if 0 < step_ns <= RATIO_MAX * step0_ns:
                weight = step_ns * step_ns / (6.0 * step0_ns * (step_ns + step0_ns))
                x, y = (
                    x + weight * (turn * y0 - turn0 * y),
                    y + weight * (turn0 * x - turn * x0),
                )
        middle = self._theta + 0.5 * turn
        scale = sinc(0.5 * turn)
        cos = scale * math.cos(middle)
        sin = scale * math.sin(middle)
        dx = cos * x - sin * y
        dy = sin * x + cos * y
        self._x += dx
        self._y += dy
        self._theta = self._theta_start + heading + self._corrected_by
        return Arc(dx, dy, cos, sin, turn)
