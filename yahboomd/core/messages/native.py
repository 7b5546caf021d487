"""The native messages: what the daemon publishes, accepts and answers, field by field.

A message only ever grows; anything else is a new message. The fields of version 0.1 are required. A
field that is added later has None as its default, for "not known": never a number or a state that
could be true. Words of a set, such as a state, are text, since sets grow too. Readers ignore fields
that they do not know. The docstrings and descriptions here end up in ``schemas/``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, TypeAlias

import msgspec
from msgspec import Meta

from yahboomd.core.model import Cause, Event, ImuEstimate, Matrix3, OdometryEstimate

Fact: TypeAlias = int | float | str | bool | None
"""A counter or a fact of one word."""

# Three levels, spelled out because msgspec has no recursive alias: the deepest group is
# command -> sources -> one source -> refusals by reason.
_Facts: TypeAlias = Mapping[str, Fact]
_Group1: TypeAlias = Mapping[str, Fact | Sequence[str] | _Facts]
_Group2: TypeAlias = Mapping[str, Fact | Sequence[str] | _Group1]
Group: TypeAlias = Mapping[str, Fact | Sequence[str] | _Group2]
"""Counters and facts by name; values may be lists of words and groups, three levels deep."""

State: TypeAlias = Literal["waiting", "standing", "driving", "stopping", "estopped", "fault"]
"""The states of this version's daemon; another version may publish others."""

DRIVABLE = frozenset[str]({"standing", "driving", "stopping"})
"""The states in which commands move the robot. In a state that is not known none may."""

INT64_MAX = 2**63 - 1
MAX_LABEL = 64
"""Characters of a ``source`` label that are kept; a label is for people."""

_STAMP = (
    "Unix time in nanoseconds; runs backwards only if the robot's clock was set back by a "
    "second or more, once for each time (event clock_stepped)."
)
Stamp = Annotated[int, Meta(ge=0, le=INT64_MAX, description=_STAMP)]
_Seq = Annotated[int, Meta(ge=0, description="Counts readings: a gap is a sample that got lost.")]
_Vx = Annotated[float, Meta(description="Forward, m/s.")]
_Vy = Annotated[float, Meta(description="To the left, m/s.")]
_Wz = Annotated[float, Meta(description="Counter-clockwise, rad/s.")]
_X = Annotated[float, Meta(description="Metres.")]
_Y = Annotated[float, Meta(description="Metres.")]
_Theta = Annotated[float, Meta(description="Heading in radians, counter-clockwise, not wrapped.")]
# What a client may set is bounded: from beyond, steps of millimetres or squares would be lost.
MAX_PLACE_M = 1e8
MAX_THETA_RAD = 1e6
MAX_VARIANCE = 1e12
_Place = Annotated[float, Meta(ge=-MAX_PLACE_M, le=MAX_PLACE_M, description="Metres.")]
_V = Annotated[float, Meta(ge=0.0, le=MAX_VARIANCE)]
_C = Annotated[float, Meta(ge=-MAX_VARIANCE, le=MAX_VARIANCE)]
_GivenCovariance: TypeAlias = tuple[_V, _C, _C, _C, _V, _C, _C, _C, _V]
_PoseCovariance = Annotated[
    Matrix3, Meta(description="Over (x, y, theta), row by row: m^2, m rad, rad^2.")
]
_TwistCovariance = Annotated[
    Matrix3, Meta(description="Over (vx, vy, wz), row by row: (m/s)^2, m rad/s^2, (rad/s)^2.")
]


# Zeros are written too: a stop that left them out would be a command without a velocity.
class VelocityCommand(msgspec.Struct, frozen=True, kw_only=True):
    """A velocity for the base, in its own frame. At least one of vx, vy, wz must be there."""

    vx: _Vx = 0.0
    vy: Annotated[
        float, Meta(description="To the left, m/s; ignored by a base that cannot do it.")
    ] = 0.0
    wz: _Wz = 0.0
    stamp_ns: Annotated[
        int | None,
        Meta(description="When the command was made, Unix ns; lets a backlog be recognised."),
    ] = None
    source: Annotated[
        str | None,
        Meta(description="A label for people; what a command may do depends on its key alone."),
    ] = None


class LinearXY(msgspec.Struct, frozen=True, kw_only=True):
    """The linear part of a velocity command in the shape of a ROS Twist."""

    x: _Vx = 0.0
    y: _Vy = 0.0


class AngularZ(msgspec.Struct, frozen=True, kw_only=True):
    """The angular part of a velocity command in the shape of a ROS Twist."""

    z: _Wz = 0.0


class RosVelocityCommand(msgspec.Struct, frozen=True, kw_only=True):
    """A velocity command in the shape of a ROS Twist, as web bridges send it."""

    linear: LinearXY = LinearXY()
    angular: AngularZ = AngularZ()


class PoseSample(msgspec.Struct, frozen=True, kw_only=True):
    """The pose of the base. One for each encoder reading; its twist has the same stamp and seq."""

    stamp_ns: Stamp
    seq: _Seq
    frame_id: Annotated[str, Meta(description="The frame of x, y and theta.")]
    child_frame_id: Annotated[str, Meta(description="The frame that is there: the base.")]
    x: _X
    y: _Y
    theta: _Theta
    covariance: _PoseCovariance


class TwistSample(msgspec.Struct, frozen=True, kw_only=True):
    """The motion of the base, in its own frame, as measured by the encoders."""

    stamp_ns: Stamp
    seq: _Seq
    frame_id: Annotated[str, Meta(description="The frame of the velocities: the base.")]
    vx: _Vx
    vy: _Vy
    wz: _Wz
    covariance: _TwistCovariance


class WheelsSample(msgspec.Struct, frozen=True, kw_only=True):
    """Every motor's wheel; the lists have one entry for each name, in the same order."""

    stamp_ns: Stamp
    seq: _Seq
    names: tuple[str, ...]
    ticks: Annotated[
        tuple[int, ...],
        Meta(description="Counts since start, positive is forward, never wrapped."),
    ]
    position_rad: Annotated[tuple[float, ...], Meta(description="Wheel angles, not wrapped.")]
    speed_m_s: Annotated[tuple[float, ...], Meta(description="Measured speed of the rims.")]
    command_m_s: Annotated[tuple[float, ...], Meta(description="Commanded speed of the rims.")]


class ImuSample(msgspec.Struct, frozen=True, kw_only=True):
    """The board's inertial sensor, along the axes of the base: forward, left, up.

    Published by boards that have one, for each sample.
    """

    stamp_ns: Stamp
    seq: Annotated[int, Meta(ge=0, description="Counts samples: a gap is one that got lost.")]
    frame_id: Annotated[str, Meta(description="The frame of the sensor.")]
    gyro_rad_s: Annotated[
        tuple[float, float, float],
        Meta(description="Rate of turn about x, y and z, with its bias; rad/s."),
    ]
    acceleration_m_s2: Annotated[
        tuple[float, float, float],
        Meta(description="Specific force along x, y and z: at rest, 9.8 upward; m/s^2."),
    ]
    gyro_bias_rad_s: Annotated[
        float, Meta(description="What the gyro shows about z at rest, as learned; rad/s.")
    ]
    theta: Annotated[
        float,
        Meta(
            description="Heading by wheels and gyro, whether the pose uses it or not; radians, not "
            "wrapped."
        ),
    ]
    gyro_variance: Annotated[float, Meta(description="Of each component of gyro_rad_s, (rad/s)^2.")]
    acceleration_variance: Annotated[
        float, Meta(description="Of each component of acceleration_m_s2, (m/s^2)^2.")
    ]
    gyro_bias_variance: Annotated[float, Meta(description="Of gyro_bias_rad_s, (rad/s)^2.")]
    theta_variance: Annotated[float, Meta(description="Of theta, rad^2.")]
    magnetic_t: Annotated[
        tuple[float, float, float] | None,
        Meta(description="The magnetic field in tesla; null without a magnetometer."),
    ] = None


class BatterySample(msgspec.Struct, frozen=True, kw_only=True):
    """The battery as the board measures it."""

    stamp_ns: Stamp
    volts: Annotated[float, Meta(description="Volts.")]


class EventSample(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Something that happened once: a discontinuity, a fault, its end."""

    stamp_ns: Stamp
    kind: Annotated[
        str, Meta(description="A stable word, such as board_reset; docs/events.md has them all.")
    ]
    severity: Annotated[
        str, Meta(description="info, warning or error; a later version may have others.")
    ]
    message: Annotated[str, Meta(description="One sentence for people.")]
    wheel: Annotated[str | None, Meta(description="The motor concerned, by name.")] = None
    data: Annotated[
        Mapping[str, Fact] | None, Meta(description="Numbers and words that belong to it.")
    ] = None


class StatusSample(msgspec.Struct, frozen=True, kw_only=True):
    """Health, counters, who drives, and why the robot stands."""

    stamp_ns: Stamp
    state: Annotated[
        str,
        Meta(
            description="waiting: no board yet; standing; driving; stopping: slowing down by "
            "itself; estopped: latched until reset; fault: motion is refused. A later version may "
            "have others: take them for states in which the robot may not drive, and may not stand."
        ),
    ]
    driver: Annotated[str | None, Meta(description="The key that has control, if any.")]
    since_ns: Annotated[int, Meta(description="Since when it is in this state, Unix ns.")]
    why: Annotated[str, Meta(description="One sentence: why it is in this state.")]
    board: Annotated[Group, Meta(description="The board: firmware, settings, problems.")]
    link: Annotated[Group, Meta(description="The serial port: frames, losses, latencies.")]
    command: Annotated[Group, Meta(description="Commands by source: accepted, refused and why.")]
    bus: Annotated[Group, Meta(description="The Zenoh session: routers, samples, drops.")]
    driver_since_ns: Annotated[
        int | None,
        Meta(description="Since when the driver has control, or no source has; none for ever."),
    ] = None
    wheels: Annotated[
        str | None,
        Meta(description="at_rest or turning, by the counts; unknown: these ceased in motion."),
    ] = None
    wheels_since_ns: Annotated[int | None, Meta(description="Since when, Unix ns.")] = None
    reasons: Annotated[Sequence[Cause] | None, Meta(description="The parts of why.")] = None


class EstopRequest(msgspec.Struct, frozen=True, kw_only=True):
    """Engages the emergency stop; false is refused, because releasing has a service of its own.

    Any other payload, an empty or a broken one too, engages as well.
    """

    engaged: bool = True
    by: Annotated[
        str | None,
        Meta(
            description="Who or what asks, for people. Read if the whole payload has 64 bytes "
            "at most."
        ),
    ] = None


class SetPoseRequest(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Asks odometry to go on from this pose."""

    x: _Place
    y: _Place
    theta: Annotated[
        float,
        Meta(
            ge=-MAX_THETA_RAD,
            le=MAX_THETA_RAD,
            description="Heading in radians, counter-clockwise, not wrapped.",
        ),
    ]
    covariance: Annotated[
        _GivenCovariance | None,
        Meta(
            description="Over (x, y, theta), row by row, symmetric and positive semidefinite; "
            "absent: known exactly."
        ),
    ] = None


class ServiceReply(msgspec.Struct, frozen=True, kw_only=True):
    """The answer of every service."""

    success: Annotated[bool, Meta(description="Whether it was done.")]
    message: Annotated[str, Meta(description="The result, or the reason of a refusal.")]
    data: Annotated[
        Mapping[str, Any], Meta(description="Values that the service returns, by name.")
    ] = msgspec.field(default_factory=dict)


def pose_sample(
    estimate: OdometryEstimate, *, stamp_ns: int, seq: int, frame_id: str, child_frame_id: str
) -> PoseSample:
    """The pose of an estimate.

    Args:
        stamp_ns: The estimate's stamp as Unix time (the estimate's own is monotonic).
    """
    pose = estimate.pose
    return PoseSample(
        stamp_ns=stamp_ns,
        seq=seq,
        frame_id=frame_id,
        child_frame_id=child_frame_id,
        x=pose.x,
        y=pose.y,
        theta=pose.theta,
        covariance=estimate.pose_covariance,
    )


def twist_sample(
    estimate: OdometryEstimate, *, stamp_ns: int, seq: int, frame_id: str
) -> TwistSample:
    """The twist of an estimate; arguments as for ``pose_sample``, with the frame of the base."""
    twist = estimate.twist
    return TwistSample(
        stamp_ns=stamp_ns,
        seq=seq,
        frame_id=frame_id,
        vx=twist.vx,
        vy=twist.vy,
        wz=twist.wz,
        covariance=estimate.twist_covariance,
    )


def wheels_sample(
    estimate: OdometryEstimate,
    *,
    stamp_ns: int,
    seq: int,
    names: tuple[str, ...],
    command_m_s: tuple[float, ...],
) -> WheelsSample:
    """The wheels of an estimate.

    Args:
        command_m_s: Rim speeds as last commanded, in the same order.
    """
    return WheelsSample(
        stamp_ns=stamp_ns,
        seq=seq,
        names=names,
        ticks=estimate.motor_ticks,
        position_rad=estimate.motor_position_rad,
        speed_m_s=estimate.motor_speed_m_s,
        command_m_s=command_m_s,
    )


def imu_sample(estimate: ImuEstimate, *, stamp_ns: int, seq: int, frame_id: str) -> ImuSample:
    """A sample of the inertial sensor; arguments as for ``pose_sample``, with its frame."""
    reading = estimate.reading
    return ImuSample(
        stamp_ns=stamp_ns,
        seq=seq,
        frame_id=frame_id,
        gyro_rad_s=reading.gyro_rad_s,
        acceleration_m_s2=reading.acceleration_m_s2,
        gyro_bias_rad_s=estimate.bias_rad_s,
        theta=estimate.theta,
        gyro_variance=reading.sensor.gyro_noise_rad_s**2,
        acceleration_variance=reading.sensor.acceleration_noise_m_s2**2,
        gyro_bias_variance=estimate.bias_variance,
        theta_variance=estimate.theta_variance,
        magnetic_t=reading.magnetic_t,
    )


def event_sample(event: Event, *, stamp_ns: int) -> EventSample:
    """An event as it goes out, stamped with Unix time."""
    return EventSample(
        stamp_ns=stamp_ns,
        kind=event.kind,
        severity=event.severity,
        message=event.message,
        wheel=event.wheel,
        data=event.data,
    )
