"""The turn of a car that steers: by its rear wheels, and by where its front wheels point.

On a curve of curvature ``k`` a car that travels ``s`` turns by ``k s``, as long as its tyres roll;
``k = tan(angle) / wheel base``. Where the front wheels point is what they were commanded, for
boards do not measure it: within a degree or so, and once the servo has arrived. Both turns are
weighted by their variances.
"""

from __future__ import annotations

ANGLE_RAD = 0.02
"""Standard deviation of the angle of the front wheels: play, trim and the servo's steps."""

ARRIVES_NS = 300_000_000
"""After a change the servo has arrived so much later."""

ALONG_M = 1.0
"""An angle is off for about so long a stretch of the way."""

SAME_PER_M = 0.02
"""Curvatures that differ by less are one."""


class Steering:
    """The knowledge of a turn by the steering.

    Args:
        base_m: From the rear axle to the front one.
    """

    __slots__ = "_variance _per_m _arrived_ns".split()

    def __init__(self, base_m: float) -> None:
        self._variance = (ANGLE_RAD / base_m) ** 2 * ALONG_M
        self._per_m: float | None = None
        self._arrived_ns = 0

    def command(self, curvature_per_m: float, now_ns: int) -> None:
        """The car was commanded to drive this curve; to the left is positive."""
        if self._per_m is None or abs(curvature_per_m - self._per_m) > SAME_PER_M:
            self._arrived_ns = now_ns + ARRIVES_NS
            self._per_m = curvature_per_m

    def correct(
        self, travel_m: float, turn: float, variance: float, now_ns: int
    ) -> tuple[float, float]:
        """Weigh the turn of a step.

        Args:
            travel_m: How far the rear wheels rolled, forward.
            turn: What they counted, radians.
            variance: Of that, rad^2.
            now_ns: When the counters were sampled.

        Returns:
            The turn to add to theirs, and the variance of the sum.
        """
        if self._per_m is None or now_ns < self._arrived_ns:
            return 0.0, variance
        own = self._variance * abs(travel_m)
        if not own or not variance:
            return 0.0, variance
        share = variance / (variance + own)
        return share * (self._per_m * travel_m - turn), share * own
