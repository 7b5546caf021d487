"""One example of every message: for ``schemas/``, and for tests in other languages."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import msgspec

from yahboomd.messages import cdr, planar, ros2
from yahboomd.messages.codecs import Reason
from yahboomd.messages.native import (
    AngularZ,
    BatterySample,
    EstopRequest,
    EventSample,
    ImuSample,
    LinearXY,
    PoseSample,
    RosVelocityCommand,
    ServiceReply,
    SetPoseRequest,
    StatusSample,
    TwistSample,
    VelocityCommand,
    WheelsSample,
)
from yahboomd.messages.rcl_interfaces import LEVELS, log
from yahboomd.messages.set_pose import pose_message
from yahboomd.model import (
    ImuEstimate,
    ImuReading,
    ImuSensor,
    OdometryEstimate,
    Pose2d,
    Twist2d,
    Vector3,
)

STAMP_NS = 1_700_000_000_123_456_789
_STAMP = {"sec": 1_700_000_000, "nanosec": 123_456_789}

_POSE = PoseSample(
    stamp_ns=STAMP_NS,
    seq=4711,
    frame_id="odom",
    child_frame_id="base_link",
    x=1.25,
    y=-0.5,
    theta=0.75,
    covariance=(4e-4, 1e-5, 2e-5, 1e-5, 9e-4, 3e-5, 2e-5, 3e-5, 2.5e-3),
)
_TWIST = TwistSample(
    stamp_ns=STAMP_NS,
    seq=4711,
    frame_id="base_link",
    vx=0.5,
    vy=0.0,
    wz=-0.25,
    covariance=(1e-4, 0.0, 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0, 4e-4),
)
_ESTIMATE = OdometryEstimate(
    stamp_ns=0,
    pose=Pose2d(x=_POSE.x, y=_POSE.y, theta=_POSE.theta),
    twist=Twist2d(vx=_TWIST.vx, vy=_TWIST.vy, wz=_TWIST.wz),
    pose_covariance=_POSE.covariance,
    twist_covariance=_TWIST.covariance,
    motor_ticks=(),
    motor_position_rad=(),
    motor_speed_m_s=(),
)
_WHEELS = WheelsSample(
    stamp_ns=STAMP_NS,
    seq=4711,
    names=("left", "right"),
    ticks=(13200, -1320),
    position_rad=(62.5, -6.25),
    speed_m_s=(0.5, -0.125),
    command_m_s=(0.5, -0.125),
)

_IMU = ImuSample(
    stamp_ns=STAMP_NS,
    seq=815,
    frame_id="imu_link",
    gyro_rad_s=(0.0, 0.0, -0.25),
    acceleration_m_s2=(0.5, -0.125, 9.75),
    gyro_bias_rad_s=0.03125,
    theta=_POSE.theta,
    gyro_variance=1e-6,
    acceleration_variance=2.5e-4,
    gyro_bias_variance=1e-8,
    theta_variance=4e-4,
    magnetic_t=(2e-5, 0.0, -4.375e-5),
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
        gyro_rad_s=_IMU.gyro_rad_s,
        acceleration_m_s2=_IMU.acceleration_m_s2,
        magnetic_t=_IMU.magnetic_t,
    ),
    stamp_ns=0,
    bias_rad_s=_IMU.gyro_bias_rad_s,
    bias_variance=_IMU.gyro_bias_variance,
    theta=_IMU.theta,
    theta_variance=_IMU.theta_variance,
)

NATIVE: dict[str, msgspec.Struct] = {
    type(message).__name__: message
    for message in (
        VelocityCommand(vx=0.5, wz=-0.25, stamp_ns=STAMP_NS, source="my_app"),
        RosVelocityCommand(linear=LinearXY(x=0.5), angular=AngularZ(z=-0.25)),
        _POSE,
        _TWIST,
        _WHEELS,
        _IMU,
        BatterySample(stamp_ns=STAMP_NS, volts=11.75),
        EventSample(
            stamp_ns=STAMP_NS,
            kind="no_counts",
            severity="error",
            message="left is commanded 0.50 m/s and its encoder shows no motion.",
            wheel="left",
            data={"commanded_m_s": 0.5, "measured_m_s": 0.0},
        ),
        StatusSample(
            stamp_ns=STAMP_NS,
            state="driving",
            driver="cmd_vel",
            driver_since_ns=1_700_000_000_000_000_000,
            since_ns=STAMP_NS - 2_000_000_000,
            why="cmd_vel drives.",
            board={
                "port": "/dev/ttyUSB0",
                "dialect": "streamed",
                "version": "1.7.3",
                "motor_type": 1,
                "lines": 11,
                "ratio": 30,
                "wheel_diameter_mm": 67.0,
                "volts": 11.75,
            },
            link={"attempts": 1, "readings": 12345, "discarded_bytes": 0, "commands_lost": 1},
            command={
                "received": 101,
                "accepted": 100,
                "refused": 1,
                "not_finite": 1,
                "last_refusal": "cmd_vel: not_finite: vx is no finite number",
                "sources": {
                    "cmd_vel": {"received": 101, "accepted": 100, "refused": {"not_finite": 1}}
                },
                "desaturated": 0,
            },
            bus={"zid": "a1b2c3", "routers": "", "neighbours": 1, "puts": 500, "put_errors": 0},
        ),
        EstopRequest(by="the red button"),
        SetPoseRequest(x=1.0, y=2.0, theta=1.5),
        ServiceReply(success=True, message="The pose was set.", data={"x": 1.0, "y": 2.0}),
    )
}
"""An example of every native message, by name."""


class CdrSample(NamedTuple):
    """A ROS 2 message: its type, its fields by their ROS 2 names, and its bytes."""

    ros_type: str
    values: dict[str, Any]
    payload: bytes


class RefusedSample(NamedTuple):
    """A velocity command that is refused, and the reason that ``status`` counts."""

    reason: Reason
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
        "linear_acceleration": _xyz(*_IMU.acceleration_m_s2),
        "linear_acceleration_covariance": [0.02**2, *[0.0] * 3, 0.02**2, *[0.0] * 3, 0.02**2],
    }


_UNMEASURED = ("temperature", "current", "charge", "capacity", "design_capacity", "percentage")


def _samples() -> dict[str, CdrSample]:
    pose, twist, wheels = _POSE, _TWIST, _WHEELS
    place = {
        "pose": {"position": _xyz(pose.x, pose.y, 0.0), "orientation": _rotation(pose.theta)},
        "covariance": list(planar.covariance(pose.covariance)),
    }
    command = _velocity(0.5, 0.0, -0.25)
    numbers = (0.5, 0.0, 0.0, 0.0, 0.0, -0.25)
    done = "The pose was set."
    reply = {"success": True, "message": done}
    diagnostic = cdr.Diagnostic(0, "yahboomd: link", "All is well.", "board", [("frames", "7")])
    return {
        "Twist": CdrSample(ros2.TWIST, command, cdr.twist(numbers)),
        "Twist_big_endian": CdrSample(ros2.TWIST, command, cdr.twist(numbers, big_endian=True)),
        "TwistStamped": CdrSample(
            ros2.TWIST_STAMPED,
            {"header": _header("base_link"), "twist": command},
            cdr.twist_stamped(STAMP_NS, "base_link", numbers),
        ),
        "Odometry": CdrSample(
            ros2.ODOMETRY,
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
            ros2.TF_MESSAGE,
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
            ros2.JOINT_STATE,
            {
                "header": _header(""),
                "name": ["left_wheel_joint", "right_wheel_joint"],
                "position": list(wheels.position_rad),
                "velocity": [15.5, -3.875],
                "effort": [],
            },
            cdr.joint_state("", ("left_wheel_joint", "right_wheel_joint"))(
                STAMP_NS, wheels.position_rad, (15.5, -3.875)
            ),
        ),
        "Imu": CdrSample(
            ros2.IMU,
            _inertial(
                *(_IMU.theta, [1e6, 0.0, 0.0, 0.0, 1e6, 0.0, 0.0, 0.0, 4e-4]),
                *((0.0, 0.0, -0.28125), 1e-6 + 1e-8),
            ),
            planar.imu("imu_link")(STAMP_NS, _IMU_ESTIMATE),
        ),
        "Imu_raw": CdrSample(
            ros2.IMU,
            _inertial(0.0, [-1.0, *[0.0] * 8], _IMU.gyro_rad_s, 1e-6),
            planar.imu_raw("imu_link")(STAMP_NS, _IMU_ESTIMATE),
        ),
        "BatteryState": CdrSample(
            ros2.BATTERY_STATE,
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
            cdr.battery_state("base_link")(STAMP_NS, 11.75, math.nan),
        ),
        "DiagnosticArray": CdrSample(
            ros2.DIAGNOSTIC_ARRAY,
            {
                "header": _header(""),
                "status": [
                    {**diagnostic._asdict(), "values": [{"key": "frames", "value": "7"}]},
                ],
            },
            cdr.diagnostics(STAMP_NS, "", [diagnostic]),
        ),
        "PoseWithCovarianceStamped": CdrSample(
            ros2.POSE,
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
        "Bool": CdrSample(ros2.BOOL, {"data": True}, cdr.boolean(True)),
        "Log": CdrSample(
            ros2.LOG,
            {
                "stamp": _STAMP,
                "level": LEVELS["warning"],
                "name": ros2.NODE,
                "msg": done,
                "file": "",
                "function": "estop",
                "line": 0,
            },
            log(STAMP_NS, LEVELS["warning"], ros2.NODE, done, "estop"),
        ),
        "Trigger_Request": CdrSample(
            f"{ros2.TRIGGER}_Request",
            {"structure_needs_at_least_one_member": 0},
            cdr.trigger_request(),
        ),
        "Trigger_Response": CdrSample(
            f"{ros2.TRIGGER}_Response", reply, cdr.service_response(True, done)
        ),
        "SetBool_Request": CdrSample(f"{ros2.SET_BOOL}_Request", {"data": True}, cdr.boolean(True)),
        "SetBool_Response": CdrSample(
            f"{ros2.SET_BOOL}_Response", reply, cdr.service_response(True, done)
        ),
    }


CDR: dict[str, CdrSample] = _samples()
"""An example of every ROS 2 message, by the name of its files."""

_TWIST_CDR = CDR["Twist"].payload

REFUSED: dict[str, RefusedSample] = {
    "json_without_velocity": RefusedSample("no_velocity", b'{"speed": 1}'),
    "json_nan": RefusedSample("not_finite", b'{"vx": NaN}'),
    "json_beyond_a_double": RefusedSample("not_finite", b'{"vx": 1e999}'),
    "json_string": RefusedSample("wrong_type", b'{"vx": "0.5"}'),
    "json_cut": RefusedSample("malformed", b'{"vx": 0.5'),
    "text": RefusedSample("unknown_encoding", b"forward"),
    "msgpack_nan": RefusedSample("not_finite", msgspec.msgpack.encode({"vx": math.nan})),
    "msgpack_trailing_byte": RefusedSample("malformed", msgspec.msgpack.encode({"vx": 1}) + b"\0"),
    "cdr_nan": RefusedSample("not_finite", cdr.twist((math.nan, 0.0, 0.0, 0.0, 0.0, 0.0))),
    "cdr_cut": RefusedSample("malformed", _TWIST_CDR[:-1]),
    "cdr_trailing_byte": RefusedSample("malformed", _TWIST_CDR + b"\0"),
}
"""Refused commands, by the name of their error."""
