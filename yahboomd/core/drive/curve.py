"""Keeps a car on the curve that was commanded, which its steering alone decides.

One law: **a wish that cannot be done is scaled along its curve**. If a speed is too high, the car
drives the same curve slower; a ramp changes the speed and not the curve. A curve that is tighter
than the steering allows becomes the tightest one, at the wished speed along the way, so that the
car never turns faster than wished. A turn on the spot is no curve: the car stands.
"""

from __future__ import annotations

import math

from yahboomd.core.model import STANDSTILL, Kinematics, Twist2d


class Curve:
    """Keeps the curve of the latest wish.

    Args:
        kinematics: The geometry. If it does not steer, wishes stay unchanged.
        linear_m_s: The largest speed along the way; None for no limit.
        angular_rad_s: The largest rate of turn; None for no limit.

    Attributes:
        per_m: The curvature, to the left positive: one over the radius.
    """

    def __init__(
        self, kinematics: Kinematics, linear_m_s: float | None, angular_rad_s: float | None
    ) -> None:
        self._tightest_per_m = (
            1.0 / kinematics.least_radius_m if kinematics.least_radius_m else None
        )
        self._linear_m_s = math.inf if linear_m_s is None else linear_m_s
        self._angular_rad_s = math.inf if angular_rad_s is None else angular_rad_s
        self.per_m = 0.0

    def steer(self, wish: Twist2d) -> tuple[Twist2d, bool]:
        """The part of a command that the car can follow.

        Returns:
            The twist, and whether the wish was tighter than the car can steer.
        """
        tightest = self._tightest_per_m
        if tightest is None:
            return wish, False
        if not wish.vx:
            return STANDSTILL, wish.wz != 0.0
        per_m = wish.wz / wish.vx
        # Allows for rounding, so that a wish exactly at the limit is not too tight.
        too_tight = abs(per_m) > tightest * (1.0 + 1e-9)
        self.per_m = per_m = max(-tightest, min(tightest, per_m))
        vx = wish.vx
        fastest = self._linear_m_s
        if per_m:
            fastest = min(fastest, self._angular_rad_s / abs(per_m))
        vx = max(-fastest, min(fastest, vx))
        return Twist2d(vx=vx, wz=vx * per_m), too_tight

    def ramped(self, limited: Twist2d) -> Twist2d:
        if self._tightest_per_m is None:
            return limited
        return Twist2d(vx=limited.vx, wz=limited.vx * self.per_m)
