"""The values that rooms pass to each other: frozen, SI units, radians, monotonic nanoseconds.

Axes follow REP 103: x forward, y left, z up; a positive turn is counter-clockwise.
"""

from __future__ import annotations

import math
from typing import Literal, TypeAlias

import msgspec

NS_PER_S = 1_000_000_000

Counts: TypeAlias = tuple[int, int, int, int]
"""One integer for each position of the board, 1 to 4 (M1..M4, the article's A..D)."""

Matrix3: TypeAlias = tuple[float, float, float, float, float, float, float, float, float]
"""A 3 by 3 matrix, row by row."""

Vector3: TypeAlias = tuple[float, float, float]
"""Components along x, y and z."""

Severity: TypeAlias = Literal["info", "warning", "error"]

EventKind: TypeAlias = Literal[
    "asked_by_name",
    "battery_empty",
    "battery_good",
    "battery_low",
    "battery_unanswered",
    "board_clock_period",
    "board_clock_unfit",
    "board_reset",
    "board_unfit",
    "clock_offset",
    "clock_stepped",
    "connected",
    "disconnected",
    "driver_changed",
    "estop",
    "estop_release_refused",
    "estop_released",
    "gyro_fit",
    "gyro_unfit",
    "latency_timer",
    "line_noisy",
    "no_counts",
    "not_started",
    "odometry_bridged",
    "odometry_discontinuity",
    "off_speed",
    "paused",
    "port_shared",
    "port_slow",
    "pose_refused",
    "pose_set",
    "reset_loop",
    "rolled",
    "router_joined",
    "router_lost",
    "runaway_against",
    "runaway_fast",
    "second_daemon",
    "setting_not_stored",
    "setting_stored",
    "stop_not_obeyed",
    "stop_not_seen",
    "turns_without_command",
    "unguarded",
    "wheels_slip",
]
"""Every kind of event; :mod:`yahboomd.tools.schemas.event_kinds` has the meanings."""

CHANNELS = 4
"""Positions of the board; every frame with per-motor numbers carries exactly this many."""


class Twist2d(msgspec.Struct, frozen=True, kw_only=True):
    """A velocity of the base, in its own frame: m/s, m/s, rad/s."""

    vx: float = 0.0
    vy: float = 0.0
    wz: float = 0.0

    @property
    def is_zero(self) -> bool:
        return self.vx == 0.0 and self.vy == 0.0 and self.wz == 0.0


STANDSTILL = Twist2d()

FASTEST_M_S = 100.0
FASTEST_RAD_S = 1000.0
"""No robot is faster. A faster command comes from a mistake, such as a division by nearly zero: it
is refused, and not limited to full speed."""


def velocity_problem(
    vx: float, vy: float, wz: float
) -> tuple[Literal["not_finite", "too_fast"], str] | None:
    """The reason to refuse a velocity: the word under which it is counted, and a sentence."""
    if not (math.isfinite(vx) and math.isfinite(vy) and math.isfinite(wz)):
        return "not_finite", f"vx {vx:g}, vy {vy:g}, wz {wz:g} is not a finite velocity."
    if max(abs(vx), abs(vy)) > FASTEST_M_S or abs(wz) > FASTEST_RAD_S:
        words = (
            f"vx {vx:g}, vy {vy:g} m/s, wz {wz:g} rad/s is faster than any robot: more than "
            f"{FASTEST_M_S:g} m/s or {FASTEST_RAD_S:g} rad/s."
        )
        return "too_fast", words
    return None


class Pose2d(msgspec.Struct, frozen=True, kw_only=True):
    """The base's place in the odometry frame: m, m, rad. ``theta`` is not wrapped."""

    x: float = 0.0
    y: float = 0.0
    theta: float = 0.0


class Motor(msgspec.Struct, frozen=True, kw_only=True):
    """One motor on the board and the wheel that it turns.

    Attributes:
        name: Its name in messages, such as ``left`` or ``front_left``.
        wheel: Index of the kinematic wheel (``Kinematics.wheels``) that it turns; in a skid-steer
            base several motors turn one "wheel", a side.
        position: Its place on the board, 1 to 4.
        command_sign: +1, or -1 if a positive command would turn the wheel backward.
        encoder_sign: +1, or -1 if the counts fall while the wheel rolls forward.
        radius_m: The radius of its wheel, calibration included.
        ticks_per_revolution: Counts of one turn of the wheel.
    """

    name: str
    wheel: int
    position: int
    command_sign: int = 1
    encoder_sign: int = 1
    radius_m: float
    ticks_per_revolution: float

    @property
    def metres_per_tick(self) -> float:
        """The travel of the rim in one count (unsigned)."""
        return 2.0 * 3.141592653589793 * self.radius_m / self.ticks_per_revolution


class Kinematics(msgspec.Struct, frozen=True, kw_only=True):
    """A drive geometry as two linear maps between the body and the wheels' rims.

    Attributes:
        name: The row of the registry, such as ``differential``.
        wheels: The names of the wheels, in the order of the rows of ``inverse``.
        inverse: For each wheel, the factors of (vx, vy, wz) in its rim speed.
        forward: Three rows (vx, vy, wz), the factors of each wheel's rim speed.
        holonomic: Whether the base can move sideways; if not, vy is refused.
        sides: Whether a wheel stands for a side, which may have several motors.
        base_m: From the rear axle to the front one, if the maps or the curves depend on it; else 0.
        least_radius_m: The tightest curve that the middle of the rear axle can drive, of a car that
            steers; 0 for a base that turns on the spot.
        turn_slip: Variance of a turn for each radian, rad^2: the track depends on the floor.
    """

    name: str
    wheels: tuple[str, ...]
    inverse: tuple[tuple[float, float, float], ...]
    forward: tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]
    holonomic: bool = False
    sides: bool = False
    base_m: float = 0.0
    least_radius_m: float = 0.0
    turn_slip: float = 0.0


class EncoderReading(msgspec.Struct, frozen=True, kw_only=True):
    """The board's cumulative counters at one moment.

    Attributes:
        ticks: Raw counters as the board sent them (int32 that wrap), positions 1 to 4.
        received_ns: When the last byte of the line was on the host's side of the wire (bytes that
            arrived behind it in the same read are taken off); monotonic nanoseconds.
        sent_ns: When the first byte of the line left the board, as far as the wire shows
            (``received_ns`` less the transfer time of the line); for a request and its answer, no
            earlier than the request's arrival on the board. Monotonic nanoseconds.
        after_reset: The first reading since the board reset itself: counters started from zero.
        after_gap: The first reading since the port was (re)opened.
        unbroken: Counts came by themselves: before this connection switched the stream on, or after
            a pause of this process. A reset switches it off, so the board was not reset since it
            was switched on last.
        requested_ns: When the request that this answers was on the board, as far as the wire shows
            (written, plus its transfer time); None for a board that streams, or if not known.
            Takes the receiving side's jitter off the stamp. Monotonic nanoseconds.
        earliest_ns: The earliest time at which the board can have sampled them: ``requested_ns``,
            unless an earlier request was not answered in time: this may be the answer to that one.
    """

    ticks: Counts
    received_ns: int
    sent_ns: int
    after_reset: bool = False
    after_gap: bool = False
    unbroken: bool = False
    requested_ns: int | None = None
    earliest_ns: int | None = None


class ImuSensor(msgspec.Struct, frozen=True, kw_only=True):
    """The limits of a kind of inertial sensor, as its board has set it up.

    Attributes:
        name: Such as ``mpu9250``.
        axes: Its axes that point forward, left and up, as its board is built.
        gyro_limit_rad_s: The fastest turn that it can report about an axis.
        gyro_noise_rad_s: Standard deviation of one sample about one axis.
        gyro_scale: Standard deviation of its scale, as a share, before it was calibrated.
        acceleration_limit_m_s2: The largest acceleration that it can report along an axis.
        acceleration_noise_m_s2: Standard deviation of one sample along one axis.
        delay_ns: How old the motion is when a sample leaves the board: filters and waiting.
    """

    name: str
    axes: str = "x y z"
    gyro_limit_rad_s: float
    gyro_noise_rad_s: float
    gyro_scale: float = 0.01
    acceleration_limit_m_s2: float
    acceleration_noise_m_s2: float
    delay_ns: int = 0


class ImuReading(msgspec.Struct, frozen=True, kw_only=True):
    """One sample of a board's inertial sensor, along the sensor's own axes.

    Attributes:
        sent_ns: When its first byte left the board, as far as the wire shows; monotonic.
        gyro_rad_s: Rate of turn about x, y and z.
        acceleration_m_s2: Specific force along x, y and z: at rest, gravity upward.
        magnetic_t: The magnetic field in tesla; None without a magnetometer.
    """

    sensor: ImuSensor
    sent_ns: int
    gyro_rad_s: Vector3
    acceleration_m_s2: Vector3
    magnetic_t: Vector3 | None = None


class ImuEstimate(msgspec.Struct, frozen=True, kw_only=True):
    """A sample of the inertial sensor, and the heading at that moment.

    Attributes:
        reading: The sample, along the axes of the base.
        stamp_ns: When it was measured; monotonic nanoseconds.
        bias_rad_s: The rate that the gyro shows about the vertical axis at rest, as learned.
        bias_variance: Its variance, (rad/s)^2.
        theta: The heading by wheels and gyro in the odometry frame, not wrapped.
        theta_variance: Its variance, rad^2.
    """

    reading: ImuReading
    stamp_ns: int
    bias_rad_s: float
    bias_variance: float
    theta: float
    theta_variance: float


class OdometryEstimate(msgspec.Struct, frozen=True, kw_only=True):
    """The pose and the motion of the robot, from one encoder reading.

    Attributes:
        stamp_ns: When the board sampled its counters; monotonic nanoseconds.
        pose: Pose of ``base_link`` in ``odom``.
        twist: Velocity in ``base_link``.
        pose_covariance: Over (x, y, theta), row by row: m^2, m rad, rad^2.
        twist_covariance: Over (vx, vy, wz), row by row.
        motor_ticks: Travelled counts per motor since start, signed (positive is forward), in the
            order of the motors; never wrapped.
        motor_position_rad: The same as wheel angles.
        motor_speed_m_s: Rim speed per motor.
    """

    stamp_ns: int
    pose: Pose2d
    twist: Twist2d
    pose_covariance: Matrix3
    twist_covariance: Matrix3
    motor_ticks: tuple[int, ...]
    motor_position_rad: tuple[float, ...]
    motor_speed_m_s: tuple[float, ...]


class Cause(msgspec.Struct, frozen=True):
    """One cause of the state that the robot is in.

    Attributes:
        kind: A stable word, so that no reader has to look into the text. A hold has its own kind;
            without motion commanded it is ``Decision.why``. The others are ``wheels`` (they may
            turn unseen), ``estop``, ``release`` (the command that lets it drive again), ``lost``
            (the client that drove has left), ``cannot`` (what is commanded cannot be done),
            ``refused``, ``battery``, ``driving``, and of the commands' rhythm ``two_programs``,
            ``too_often`` and ``too_seldom``.
        text: One sentence or more, for a person.
    """

    kind: str
    text: str


class Event(msgspec.Struct, frozen=True, kw_only=True):
    """Something that happened once, published for people and programs.

    Attributes:
        message: One sentence: the event, yahboomd's reaction, and the remedy.
        wheel: The motor concerned, by name.
        data: Numbers and words that belong to it.
    """

    kind: EventKind
    severity: Severity
    message: str
    wheel: str | None = None
    data: dict[str, int | float | str | bool | None] | None = None
