"""Compares poses and twists of a moving robot with the ground truth at their stamps."""

from __future__ import annotations

import bisect
import math
from collections.abc import Sequence

from benchmarks.soak.poses import error, way_covariance
from yahboomd.core.messages.native import PoseSample, TwistSample
from yahboomd.simulation.truth import TruthSample

LATE_S = 0.05
"""The most by which a stamp may differ from the moment of the pose."""

MARGIN_M = 0.03
MARGIN_M_S = 0.1
SIGMAS = 3.0

TWIST_SPAN_NS = 1_200_000_000
"""A twist is a mean since the previous reading, and a gap makes that time long."""

AROUND_NS = 300_000_000


class Track:
    """The ground truth of some seconds, at any moment within.

    Args:
        truths: The samples, in the order of time.
        wall_ns: Unix time less monotonic time.
    """

    def __init__(self, truths: Sequence[TruthSample], wall_ns: int) -> None:
        self._truths = truths
        self._times = [truth.t_ns for truth in truths]
        self._wall_ns = wall_ns

    def at(self, stamp_ns: int) -> TruthSample | None:
        """The sample at a Unix stamp; None outside."""
        t_ns = stamp_ns - self._wall_ns
        if not self._times or not self._times[0] <= t_ns <= self._times[-1]:
            return None
        return self._truths[bisect.bisect_left(self._times, t_ns)]

    def between(self, first_ns: int, last_ns: int) -> Sequence[TruthSample]:
        """The samples from one Unix stamp to another."""
        first = bisect.bisect_left(self._times, first_ns - self._wall_ns)
        last = bisect.bisect_right(self._times, last_ns - self._wall_ns)
        return self._truths[first:last]

    def fastest_m_s(self, stamp_ns: int) -> float:
        """The greatest rim speed around a Unix stamp."""
        around = self.between(stamp_ns - AROUND_NS, stamp_ns + AROUND_NS)
        return max((max(map(abs, truth.speed_m_s)) for truth in around), default=0.0)


def pose_excess_m(
    anchor: PoseSample, anchor_truth: TruthSample, poses: Sequence[PoseSample], track: Track
) -> float:
    """The largest distance of a pose from the truth at its stamp, beyond the allowed one.

    Allowed are :data:`MARGIN_M`, the covariance's share, and :data:`LATE_S` of driving.
    """
    worst_m = 0.0
    for pose in poses:
        truth = track.at(pose.stamp_ns)
        if truth is None:
            continue
        then, now = (anchor.x, anchor.y, anchor.theta), (pose.x, pose.y, pose.theta)
        off_m, _ = error(
            then,
            now,
            (anchor_truth.x, anchor_truth.y, anchor_truth.theta),
            (truth.x, truth.y, truth.theta),
        )
        xx, yy, _ = way_covariance(then, anchor.covariance, now, pose.covariance)
        most_m = MARGIN_M + SIGMAS * math.sqrt(xx + yy) + LATE_S * track.fastest_m_s(pose.stamp_ns)
        worst_m = max(worst_m, off_m - most_m)
    return worst_m


def twist_excess_m_s(twists: Sequence[TwistSample], track: Track) -> float:
    """The most by which a forward speed lies outside of the robot's recent true speeds.

    Allowed are :data:`MARGIN_M_S` and the covariance's share.
    """
    worst_m_s = 0.0
    for twist in twists:
        if track.at(twist.stamp_ns) is None:
            continue
        lately = [
            truth.vx for truth in track.between(twist.stamp_ns - TWIST_SPAN_NS, twist.stamp_ns)
        ]
        off_m_s = max(twist.vx - max(lately), min(lately) - twist.vx)
        most_m_s = MARGIN_M_S + SIGMAS * math.sqrt(max(0.0, twist.covariance[0]))
        worst_m_s = max(worst_m_s, off_m_s - most_m_s)
    return worst_m_s
