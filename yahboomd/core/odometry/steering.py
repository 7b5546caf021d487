"""The turn of a car that steers, from its rear wheels and from the angle of its front wheels.

A car that travels ``s`` on a curve of curvature ``k`` turns by ``k s`` while its tyres roll;
``k = tan(angle) / wheel base``. Boards do not measure the angle of the front wheels, so the
commanded one is used: right within a degree or so, once the servo has arrived. Both turns are
weighted by their variances.
"""

from __future__ import annotations

ANGLE_RAD = 0.02
"""Standard deviation of the angle of the front wheels: play, trim and the servo's steps."""

ARRIVES_NS = 300_000_000
"""The time after a change until the servo has arrived."""

ALONG_M = 1.0
"""The distance over which an error of the angle lasts."""

SAME_PER_M = 0.02
"""Curvatures that differ by less count as one."""


class Steering:
    """Corrects the turn of the rear wheels by the steering.

    Args:
        base_m: From the rear axle to the front one.
    """

    __slots__ = "_variance _per_m _arrived_ns".split()

    def __init__(self, base_m: float) -> None:
        self._variance = (ANGLE_RAD / base_m) ** 2 * ALONG_M
        self._per_m: float | None = None
        self._arrived_ns = 0

    def command(self, curvature_per_m: float, now_ns: int) -> None:
        """Note the commanded curve; to the left is positive."""
        if self._per_m is None or abs(curvature_per_m - self._per_m) > SAME_PER_M:
            self._arrived_ns = now_ns + ARRIVES_NS
            self._per_m = curvature_per_m

    def correct(
        self, travel_m: float, turn: float, variance: float, now_ns: int
    ) -> tuple[float, float]:
        """Weigh the turn of a step.

        Args:
            travel_m: Travel of the rear wheels, forward.
            turn: The turn that they counted, radians.
            variance: Its variance, rad^2.
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
