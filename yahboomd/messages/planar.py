"""A base in the plane, in the six dimensions of ROS 2 (REP 103, REP 105)."""

from __future__ import annotations

import math
from collections.abc import Callable

from yahboomd.messages import cdr
from yahboomd.messages.native import PoseSample, TwistSample
from yahboomd.model import Matrix3

UNMEASURED = 1e6
"""The variance of what wheels cannot tell (z, roll, pitch): so large that filters give it no
weight, and not zero, which would claim perfect knowledge."""

Numbers = tuple[float, ...]


def quaternion(theta: float) -> tuple[float, float, float, float]:
    """A heading about z as (x, y, z, w)."""
    half = 0.5 * theta
    return (0.0, 0.0, math.sin(half), math.cos(half))


def pose(sample: PoseSample) -> Numbers:
    """Position and quaternion, 7 numbers; a transform's translation and rotation are the same."""
    return (sample.x, sample.y, 0.0, *quaternion(sample.theta))


def twist(sample: TwistSample) -> Numbers:
    """Linear and angular velocity, 6 numbers."""
    return (sample.vx, sample.vy, 0.0, 0.0, 0.0, sample.wz)


def covariance(planar: Matrix3) -> Numbers:
    """3 by 3 over (x, y, yaw) as 6 by 6 over (x, y, z, roll, pitch, yaw), row by row."""
    xx, xy, xt, yx, yy, yt, tx, ty, tt = planar
    u = UNMEASURED
    return (
        *(xx, xy, 0.0, 0.0, 0.0, xt),
        *(yx, yy, 0.0, 0.0, 0.0, yt),
        *(0.0, 0.0, u, 0.0, 0.0, 0.0),
        *(0.0, 0.0, 0.0, u, 0.0, 0.0),
        *(0.0, 0.0, 0.0, 0.0, u, 0.0),
        *(tx, ty, 0.0, 0.0, 0.0, tt),
    )


def odometry(frame_id: str, child_frame_id: str) -> Callable[[PoseSample, TwistSample], bytes]:
    """An encoder of nav_msgs/msg/Odometry from the pose and the twist of one reading."""
    encoder = cdr.odometry(frame_id, child_frame_id)

    def encode(pose_sample: PoseSample, twist_sample: TwistSample) -> bytes:
        return encoder(
            pose_sample.stamp_ns,
            pose(pose_sample),
            covariance(pose_sample.covariance),
            twist(twist_sample),
            covariance(twist_sample.covariance),
        )

    return encode


def transform(frame_id: str, child_frame_id: str) -> Callable[[PoseSample], bytes]:
    """An encoder of tf2_msgs/msg/TFMessage with the one transform that odometry gives."""
    encoder = cdr.transforms([(frame_id, child_frame_id)])

    def encode(sample: PoseSample) -> bytes:
        return encoder(sample.stamp_ns, (pose(sample),))

    return encode
