"""One example of every message of ROS 2: its fields and its bytes in CDR."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from make.schema_files.samples import IMU, POSE, STAMP_NS, TWIST, WHEELS
from yahboomd.core.messages import cdr
from yahboomd.core.model import (
    ImuEstimate,
    ImuReading,
    ImuSensor,
    OdometryEstimate,
    Pose2d,
    Twist2d,
    Vector3,
)
from yahboomd.ros2.messages import planar, ros2_encoders, ros2_names
from yahboomd.ros2.messages.rcl_interfaces import LEVELS, log

_STAMP = {"sec": 1_700_000_000, "nanosec": 123_456_789}

_ESTIMATE = OdometryEstimate(
    stamp_ns=0,
    pose=Pose2d(x=POSE.x, y=POSE.y, theta=POSE.theta),
    twist=Twist2d(vx=TWIST.vx, vy=TWIST.vy, wz=TWIST.wz),
    pose_covariance=POSE.covariance,
    twist_covariance=TWIST.covariance,
    motor_ticks=(),
    motor_position_rad=(),
    motor_speed_m_s=(),
)
_IMU_ESTIMATE = ImuEstimate(
    reading=ImuReading(
        sensor=ImuSensor(
            name="icm20948",
            gyro_limit_rad_s=32.0,
            gyro_noise_rad_s=1e-3,
            acceleration_limit_m_s2=32.0,
            acceleration_noise_m_s2=0.02,
        ),
        sent_ns=0,
        gyro_rad_s=IMU.gyro_rad_s,
        acceleration_m_s2=IMU.acceleration_m_s2,
        magnetic_t=IMU.magnetic_t,
    ),
    stamp_ns=0,
    bias_rad_s=IMU.gyro_bias_rad_s,
    bias_variance=IMU.gyro_bias_variance,
    theta=IMU.theta,
    theta_variance=IMU.theta_variance,
)


def pose_message(stamp_ns: int, frame_id: str, numbers: Sequence[float]) -> bytes:
    """A geometry_msgs/msg/PoseWithCovarianceStamped.

    Args:
        numbers: Position, quaternion, and 36 covariances.
    """
    frame = frame_id.encode()
    pack = ros2_encoders.Layout().add("I", 4, 2).text(frame).add("d", 8, 43).packer()
    return pack(cdr.HEADER_LE, *ros2_encoders.stamp(stamp_ns), len(frame) + 1, frame, *numbers)


class CdrSample(NamedTuple):
    """A ROS 2 message: its type, its fields by their ROS 2 names, and its bytes."""

    ros_type: str
    values: dict[str, Any]
    payload: bytes


def _header(frame_id: str) -> dict[str, Any]:
    return {"stamp": _STAMP, "frame_id": frame_id}


def _xyz(x: float, y: float, z: float) -> dict[str, float]:
    return {"x": x, "y": y, "z": z}


def _rotation(theta: float) -> dict[str, float]:
    return dict(zip("xyzw", planar.quaternion(theta), strict=True))


def _velocity(vx: float, vy: float, wz: float) -> dict[str, Any]:
    return {"linear": _xyz(vx, vy, 0.0), "angular": _xyz(0.0, 0.0, wz)}


def _inertial(
    theta: float, theta_covariance: list[float], gyro_rad_s: Vector3, about_z: float
) -> dict[str, Any]:
    return {
        "header": _header("imu_link"),
        "orientation": _rotation(theta),
        "orientation_covariance": theta_covariance,
        "angular_velocity": _xyz(*gyro_rad_s),
        "angular_velocity_covariance": [1e-6, 0.0, 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0, about_z],
        "linear_acceleration": _xyz(*IMU.acceleration_m_s2),
        "linear_acceleration_covariance": [0.02**2, *[0.0] * 3, 0.02**2, *[0.0] * 3, 0.02**2],
    }


_UNMEASURED = ("temperature", "current", "charge", "capacity", "design_capacity", "percentage")


def _samples() -> dict[str, CdrSample]:
    pose, twist, wheels = POSE, TWIST, WHEELS
    place = {
        "pose": {"position": _xyz(pose.x, pose.y, 0.0), "orientation": _rotation(pose.theta)},
        "covariance": list(planar.covariance(pose.covariance)),
    }
    command = _velocity(0.5, 0.0, -0.25)
    numbers = (0.5, 0.0, 0.0, 0.0, 0.0, -0.25)
    done = "The pose was set."
    reply = {"success": True, "message": done}
    diagnostic = ros2_encoders.Diagnostic(
        0, "yahboomd: link", "All is well.", "board", [("frames", "7")]
    )
    return {
        "Twist": CdrSample(ros2_names.TWIST, command, ros2_encoders.twist(numbers)),
        "Twist_big_endian": CdrSample(
            ros2_names.TWIST, command, ros2_encoders.twist(numbers, big_endian=True)
        ),
        "TwistStamped": CdrSample(
            ros2_names.TWIST_STAMPED,
            {"header": _header("base_link"), "twist": command},
            ros2_encoders.twist_stamped(STAMP_NS, "base_link", numbers),
        ),
        "Odometry": CdrSample(
            ros2_names.ODOMETRY,
            {
                "header": _header("odom"),
                "child_frame_id": "base_link",
                "pose": place,
                "twist": {
                    "twist": _velocity(twist.vx, twist.vy, twist.wz),
                    "covariance": list(planar.covariance(twist.covariance)),
                },
            },
            planar.odometry("odom", "base_link")(STAMP_NS, _ESTIMATE),
        ),
        "TFMessage": CdrSample(
            ros2_names.TF_MESSAGE,
            {
                "transforms": [
                    {
                        "header": _header("odom"),
                        "child_frame_id": "base_link",
                        "transform": {
                            "translation": _xyz(pose.x, pose.y, 0.0),
                            "rotation": _rotation(pose.theta),
                        },
                    }
                ]
            },
            planar.transform("odom", "base_link")(STAMP_NS, _ESTIMATE.pose),
        ),
        "JointState": CdrSample(
            ros2_names.JOINT_STATE,
            {
                "header": _header(""),
                "name": ["left_wheel_joint", "right_wheel_joint"],
                "position": list(wheels.position_rad),
                "velocity": [15.5, -3.875],
                "effort": [],
            },
            ros2_encoders.joint_state("", ("left_wheel_joint", "right_wheel_joint"))(
                STAMP_NS, wheels.position_rad, (15.5, -3.875)
            ),
        ),
        "Imu": CdrSample(
            ros2_names.IMU,
            _inertial(
                *(IMU.theta, [1e6, 0.0, 0.0, 0.0, 1e6, 0.0, 0.0, 0.0, 4e-4]),
                *((0.0, 0.0, -0.28125), 1e-6 + 1e-8),
            ),
            planar.imu("imu_link")(STAMP_NS, _IMU_ESTIMATE),
        ),
        "Imu_raw": CdrSample(
            ros2_names.IMU,
            _inertial(0.0, [-1.0, *[0.0] * 8], IMU.gyro_rad_s, 1e-6),
            planar.imu_raw("imu_link")(STAMP_NS, _IMU_ESTIMATE),
        ),
        "BatteryState": CdrSample(
            ros2_names.BATTERY_STATE,
            {
                "header": _header("base_link"),
                "voltage": 11.75,
                **dict.fromkeys(_UNMEASURED, math.nan),
                "power_supply_status": 0,
                "power_supply_health": 0,
                "power_supply_technology": 0,
                "present": True,
                "cell_voltage": [],
                "cell_temperature": [],
                "location": "",
                "serial_number": "",
            },
            ros2_encoders.battery_state("base_link")(STAMP_NS, 11.75, math.nan),
        ),
        "DiagnosticArray": CdrSample(
            ros2_names.DIAGNOSTIC_ARRAY,
            {
                "header": _header(""),
                "status": [
                    {**diagnostic._asdict(), "values": [{"key": "frames", "value": "7"}]},
                ],
            },
            ros2_encoders.diagnostics(STAMP_NS, "", [diagnostic]),
        ),
        "PoseWithCovarianceStamped": CdrSample(
            ros2_names.POSE,
            {
                "header": _header("odom"),
                "pose": place,
            },
            pose_message(
                STAMP_NS,
                "odom",
                (*planar.pose(_ESTIMATE.pose), *planar.covariance(pose.covariance)),
            ),
        ),
        "Bool": CdrSample(ros2_names.BOOL, {"data": True}, ros2_encoders.boolean(True)),
        "Log": CdrSample(
            ros2_names.LOG,
            {
                "stamp": _STAMP,
                "level": LEVELS["warning"],
                "name": ros2_names.NODE,
                "msg": done,
                "file": "",
                "function": "estop",
                "line": 0,
            },
            log(STAMP_NS, LEVELS["warning"], ros2_names.NODE, done, "estop"),
        ),
        "Trigger_Request": CdrSample(
            f"{ros2_names.TRIGGER}_Request",
            {"structure_needs_at_least_one_member": 0},
            ros2_encoders.trigger_request(),
        ),
        "Trigger_Response": CdrSample(
            f"{ros2_names.TRIGGER}_Response", reply, cdr.service_response(True, done)
        ),
        "SetBool_Request": CdrSample(
            f"{ros2_names.SET_BOOL}_Request", {"data": True}, ros2_encoders.boolean(True)
        ),
        "SetBool_Response": CdrSample(
            f"{ros2_names.SET_BOOL}_Response", reply, cdr.service_response(True, done)
        ),
    }


CDR: dict[str, CdrSample] = _samples()
"""An example of every ROS 2 message, by the name of its files."""
