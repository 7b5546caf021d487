"""A base in the plane, in the six dimensions of ROS 2 (REP 103, REP 105)."""

from __future__ import annotations

import math
from collections.abc import Callable

from yahboomd.core.model import ImuEstimate, Matrix3, OdometryEstimate, Pose2d, Twist2d
from yahboomd.ros2.messages import ros2_encoders

UNMEASURED = 1e6
"""The variance of axes that wheels cannot measure (z, roll, pitch): large enough that filters give
them no weight. Zero would claim perfect knowledge."""

Numbers = tuple[float, ...]


def quaternion(theta: float) -> tuple[float, float, float, float]:
    """A heading about z as (x, y, z, w)."""
    half = 0.5 * theta
    return (0.0, 0.0, math.sin(half), math.cos(half))


def rotation(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Turns about the fixed axes x, y, z, in this order, as a quaternion (x, y, z, w).

    The angles of a URDF's ``rpy``: the product of the quaternions about z, y and x.
    """
    sr, cr = math.sin(0.5 * roll), math.cos(0.5 * roll)
    sp, cp = math.sin(0.5 * pitch), math.cos(0.5 * pitch)
    sy, cy = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def pose(pose: Pose2d) -> Numbers:
    """Position and quaternion, 7 numbers; a transform's translation and rotation are the same."""
    return (pose.x, pose.y, 0.0, *quaternion(pose.theta))


def twist(twist: Twist2d) -> Numbers:
    return (twist.vx, twist.vy, 0.0, 0.0, 0.0, twist.wz)


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


def odometry(frame_id: str, child_frame_id: str) -> Callable[[int, OdometryEstimate], bytes]:
    """An encoder of nav_msgs/msg/Odometry from a stamp (Unix ns) and an estimate."""
    encoder = ros2_encoders.odometry(frame_id, child_frame_id)

    def encode(stamp_ns: int, estimate: OdometryEstimate) -> bytes:
        return encoder(
            stamp_ns,
            pose(estimate.pose),
            covariance(estimate.pose_covariance),
            twist(estimate.twist),
            covariance(estimate.twist_covariance),
        )

    return encode


def transform(frame_id: str, child_frame_id: str) -> Callable[[int, Pose2d], bytes]:
    """An encoder of tf2_msgs/msg/TFMessage with the one transform that odometry gives."""
    encoder = ros2_encoders.transforms([(frame_id, child_frame_id)])

    def encode(stamp_ns: int, where: Pose2d) -> bytes:
        return encoder(stamp_ns, (pose(where),))

    return encode


ImuBytes = Callable[[int, ImuEstimate], bytes]
"""Encodes a sample of the inertial sensor with a stamp (Unix ns)."""


def imu_raw(frame_id: str) -> ImuBytes:
    """Returns an encoder of raw samples as sensor_msgs/msg/Imu, for ``imu/data_raw`` (REP 145).

    They have no orientation: the first element of that covariance is -1.
    """
    encoder = ros2_encoders.imu(frame_id)
    nothing = (0.0, 0.0, 0.0, 1.0, -1.0, *[0.0] * 8)

    def encode(stamp_ns: int, estimate: ImuEstimate) -> bytes:
        reading, sensor = estimate.reading, estimate.reading.sensor
        turn, force = sensor.gyro_noise_rad_s**2, sensor.acceleration_noise_m_s2**2
        return encoder(
            stamp_ns,
            nothing,
            (*reading.gyro_rad_s, *_diagonal(turn, turn, turn)),
            (*reading.acceleration_m_s2, *_diagonal(force, force, force)),
        )

    return encode


def imu(frame_id: str) -> ImuBytes:
    """An encoder of sensor_msgs/msg/Imu with an orientation, for ``imu/data`` (REP 145).

    Yaw is the heading by wheels and gyro, and the rate about z is without its bias. Roll and pitch
    are not measured.
    """
    encoder = ros2_encoders.imu(frame_id)

    def encode(stamp_ns: int, estimate: ImuEstimate) -> bytes:
        reading, sensor = estimate.reading, estimate.reading.sensor
        turn, force = sensor.gyro_noise_rad_s**2, sensor.acceleration_noise_m_s2**2
        x, y, z = reading.gyro_rad_s
        return encoder(
            stamp_ns,
            (
                *quaternion(estimate.theta),
                *_diagonal(UNMEASURED, UNMEASURED, estimate.theta_variance),
            ),
            (x, y, z - estimate.bias_rad_s, *_diagonal(turn, turn, turn + estimate.bias_variance)),
            (*reading.acceleration_m_s2, *_diagonal(force, force, force)),
        )

    return encode


def _diagonal(x: float, y: float, z: float) -> Numbers:
    return (x, 0.0, 0.0, 0.0, y, 0.0, 0.0, 0.0, z)
