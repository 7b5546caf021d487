"""Checks each published pose for jumps, shrinking covariance and wrong stamps."""

from __future__ import annotations

import math

import msgspec

from yahboomd.core.messages.native import PoseSample
from yahboomd.core.model import Matrix3

V_MAX_M_S = 2.0
"""A rim speed that no wheel reaches: the daemon's default."""

SEPARATION_M = 0.15
TICK_M = math.pi * 0.067 / 1320
STAMP_SLACK_S = 1e-6
"""Allows for the wall clock, which is adjusted while it runs."""

MOST_FOUND = 10_000

AHEAD_S = 0.002
"""A stamp may be later than its sample's arrival by less, because clocks are read one by one."""


class Jump(msgspec.Struct, frozen=True, kw_only=True):
    """Two consecutive samples that are impossible.

    Attributes:
        kind: ``position``, ``heading``, ``covariance``, ``stamp`` or ``future``.
        step: The step: metres, radians, a ratio, seconds.
        most: The largest possible step.
        stamp_ns: The stamp of the second sample.
    """

    kind: str
    step: float
    most: float
    stamp_ns: int


class PoseWatch:
    """Compares each pose with the one before it.

    A jump is a step longer than v_max x Δt plus one count (for the heading: both wheels, over the
    track). The covariance shrinks if its determinant does.

    Attributes:
        found: The jumps, up to :data:`MOST_FOUND`.
        samples: The number of compared samples.
        fastest_m_s: The fastest step, less a count, over its time.
    """

    def __init__(self) -> None:
        self.found: list[Jump] = []
        self.samples = 0
        self.fastest_m_s = 0.0
        self._last: PoseSample | None = None
        self._paused = False

    def pause(self) -> None:
        """Pause the comparison while the pose is set."""
        self._paused = True

    def resume(self) -> None:
        """Continue after the pose was set and older samples have arrived."""
        self._last = None
        self._paused = False

    def see(self, pose: PoseSample, now_ns: int | None = None) -> None:
        """Compare a sample with the previous one, and its stamp with the Unix time now."""
        if self._paused:
            return
        if now_ns is not None and pose.stamp_ns > now_ns + AHEAD_S * 1e9:
            self._add("future", (pose.stamp_ns - now_ns) / 1e9, AHEAD_S, pose)
        last, self._last = self._last, pose
        self.samples += 1
        if last is None or pose.seq <= last.seq:
            # A new daemon starts at zero.
            return
        dt_s = (pose.stamp_ns - last.stamp_ns) / 1e9
        if dt_s <= 0.0:
            self._add("stamp", dt_s, 0.0, pose)
            return
        step_m = math.hypot(pose.x - last.x, pose.y - last.y)
        self.fastest_m_s = max(self.fastest_m_s, (step_m - TICK_M) / dt_s)
        turn = abs(pose.theta - last.theta)
        rolled_m = V_MAX_M_S * (dt_s + STAMP_SLACK_S) + TICK_M
        self._check("position", step_m, rolled_m, pose)
        self._check("heading", turn, 2.0 * rolled_m / SEPARATION_M, pose)
        before, after = determinant(last.covariance), determinant(pose.covariance)
        # For rounding: a determinant is a difference of products as large as its diagonal's.
        rounding = 1e-9 * pose.covariance[0] * pose.covariance[4] * pose.covariance[8]
        if after < before * (1.0 - 1e-9) - rounding:
            self._add("covariance", after, before, pose)

    def _check(self, kind: str, step: float, most: float, pose: PoseSample) -> None:
        if step > most:
            self._add(kind, step, most, pose)

    def _add(self, kind: str, step: float, most: float, pose: PoseSample) -> None:
        if len(self.found) < MOST_FOUND:
            self.found.append(Jump(kind=kind, step=step, most=most, stamp_ns=pose.stamp_ns))


def determinant(m: Matrix3) -> float:
    """The determinant of a 3 x 3 matrix, given row by row."""
    return (
        m[0] * (m[4] * m[8] - m[5] * m[7])
        - m[1] * (m[3] * m[8] - m[5] * m[6])
        + m[2] * (m[3] * m[7] - m[4] * m[6])
    )


def error(
    pose_0: tuple[float, float, float],
    pose_1: tuple[float, float, float],
    truth_0: tuple[float, float, float],
    truth_1: tuple[float, float, float],
) -> tuple[float, float]:
    """The distance between the measured and the true end of a way.

    Both are relative to their beginnings.

    Returns:
        Metres and radians.
    """
    x, y, theta = _from(pose_0, pose_1)
    true_x, true_y, true_theta = _from(truth_0, truth_1)
    return math.hypot(x - true_x, y - true_y), abs(theta - true_theta)


def way_covariance(
    then: tuple[float, float, float], p_then: Matrix3, now: tuple[float, float, float], p: Matrix3
) -> tuple[float, float, float]:
    """The covariance of the way between two poses, without the uncertainty from before it.

    An error of the heading swings the rest of the way around the place of the error:
    ``P = J · P_then · Jᵀ + Q`` with ``J = [1 0 -dy; 0 1 dx; 0 0 1]``; this is Q's diagonal.

    Returns:
        Variances of x, y and the heading, none below zero.
    """
    dx, dy = now[0] - then[0], now[1] - then[1]
    xx, _, xt, _, yy, yt, _, _, tt = p_then
    return (
        max(0.0, p[0] - (xx - 2.0 * dy * xt + dy * dy * tt)),
        max(0.0, p[4] - (yy + 2.0 * dx * yt + dx * dx * tt)),
        max(0.0, p[8] - tt),
    )


def _from(
    start: tuple[float, float, float], goal: tuple[float, float, float]
) -> tuple[float, float, float]:
    dx, dy = goal[0] - start[0], goal[1] - start[1]
    cos, sin = math.cos(start[2]), math.sin(start[2])
    return cos * dx + sin * dy, cos * dy - sin * dx, goal[2] - start[2]
