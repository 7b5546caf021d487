"""One example of every native message: for ``schemas/``, and for tests in other languages.

:mod:`.cdr_samples` has those of ROS 2.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import msgspec

from yahboomd.core.drive.standing import why
from yahboomd.core.messages.codecs import Reason
from yahboomd.core.messages.native import (
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
from yahboomd.core.model import Cause
from yahboomd.ros2.messages import ros2_encoders

STAMP_NS = 1_700_000_000_123_456_789
REASONS = [
    Cause(
        "two_programs",
        "Two programs command cmd_vel: 0.50 m/s (nav) and 0 (joy). End one of them, or give it "
        "another source.",
    ),
    Cause("battery", "The battery is empty: 9.2 V at rest, less than board.battery_stop_v = 9.6."),
]

POSE = PoseSample(
    stamp_ns=STAMP_NS,
    seq=4711,
    frame_id="odom",
    child_frame_id="base_link",
    x=1.25,
    y=-0.5,
    theta=0.75,
    covariance=(4e-4, 1e-5, 2e-5, 1e-5, 9e-4, 3e-5, 2e-5, 3e-5, 2.5e-3),
)
TWIST = TwistSample(
    stamp_ns=STAMP_NS,
    seq=4711,
    frame_id="base_link",
    vx=0.5,
    vy=0.0,
    wz=-0.25,
    covariance=(1e-4, 0.0, 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0, 4e-4),
)
WHEELS = WheelsSample(
    stamp_ns=STAMP_NS,
    seq=4711,
    names=("left", "right"),
    ticks=(13200, -1320),
    position_rad=(62.5, -6.25),
    speed_m_s=(0.5, -0.125),
    command_m_s=(0.5, -0.125),
)

IMU = ImuSample(
    stamp_ns=STAMP_NS,
    seq=815,
    frame_id="imu_link",
    gyro_rad_s=(0.0, 0.0, -0.25),
    acceleration_m_s2=(0.5, -0.125, 9.75),
    gyro_bias_rad_s=0.03125,
    theta=POSE.theta,
    gyro_variance=1e-6,
    acceleration_variance=2.5e-4,
    gyro_bias_variance=1e-8,
    theta_variance=4e-4,
    magnetic_t=(2e-5, 0.0, -4.375e-5),
)
NATIVE: dict[str, msgspec.Struct] = {
    type(message).__name__: message
    for message in (
        VelocityCommand(vx=0.5, wz=-0.25, stamp_ns=STAMP_NS, source="my_app"),
        RosVelocityCommand(linear=LinearXY(x=0.5), angular=AngularZ(z=-0.25)),
        POSE,
        TWIST,
        WHEELS,
        IMU,
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
            why=why(REASONS),
            reasons=REASONS,
            wheels="turning",
            wheels_since_ns=STAMP_NS - 1_500_000_000,
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

MESSAGES: dict[str, type[msgspec.Struct]] = {name: type(sample) for name, sample in NATIVE.items()}
"""Every native message by its name."""


class RefusedSample(NamedTuple):
    """A velocity command that is refused, and the reason that ``status`` counts."""

    reason: Reason
    payload: bytes


_TWIST_CDR = ros2_encoders.twist((0.5, 0.0, 0.0, 0.0, 0.0, -0.25))

REFUSED: dict[str, RefusedSample] = {
    "json_without_velocity": RefusedSample("no_velocity", b'{"speed": 1}'),
    "json_nan": RefusedSample("not_finite", b'{"vx": NaN}'),
    "json_beyond_a_double": RefusedSample("not_finite", b'{"vx": 1e999}'),
    "json_too_fast": RefusedSample("too_fast", b'{"vx": 1e39}'),
    "json_string": RefusedSample("wrong_type", b'{"vx": "0.5"}'),
    "json_cut": RefusedSample("malformed", b'{"vx": 0.5'),
    "text": RefusedSample("unknown_encoding", b"forward"),
    "msgpack_nan": RefusedSample("not_finite", msgspec.msgpack.encode({"vx": math.nan})),
    "msgpack_too_fast": RefusedSample("too_fast", msgspec.msgpack.encode({"wz": -1e39})),
    "msgpack_trailing_byte": RefusedSample("malformed", msgspec.msgpack.encode({"vx": 1}) + b"\0"),
    "cdr_nan": RefusedSample(
        "not_finite", ros2_encoders.twist((math.nan, 0.0, 0.0, 0.0, 0.0, 0.0))
    ),
    "cdr_too_fast": RefusedSample("too_fast", ros2_encoders.twist((1e39, 0.0, 0.0, 0.0, 0.0, 0.0))),
    "cdr_cut": RefusedSample("malformed", _TWIST_CDR[:-1]),
    "cdr_trailing_byte": RefusedSample("malformed", _TWIST_CDR + b"\0"),
}
"""Refused commands, by the name of their error."""
