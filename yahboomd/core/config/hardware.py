"""The sections on hardware: serial port, board, chassis."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, TypeAlias

from pydantic import Field

from yahboomd.core.config.values import (
    AnyPath,
    Checked,
    Choice,
    Frame,
    MotorName,
    Positive,
    RelayLine,
    Section,
    Sign,
)
from yahboomd.core.drive.kinematics import KINEMATICS
from yahboomd.core.odometry.imu_axes import Mounting, axes_problem
from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.core.protocol.registry import DIALECTS

CUSTOM = "custom"
"""The profile whose figures are in the configuration."""


class Serial(Section):
    """The serial port of the board."""

    port: AnyPath = Field(
        default="",
        description="Device of the board, such as /dev/ttyUSB0. Empty: the only CH340 (1a86:7523, "
        "1a86:7522) on USB, or /dev/yahboom_driver; of several the one that is heard, else the "
        "one that answers, 1a86:7523 asked first; two boards are refused. Not a pseudo-terminal "
        "of a relay (socat, ser2net): if it sends slowly, stops come seconds late.",
    )
    baudrate: int = Field(
        default=115200,
        ge=1200,
        le=4_000_000,
        description="Bits per second; the board's firmware supports only 115200.",
    )
    dialect: Annotated[str, Choice(("auto",), DIALECTS)] = Field(
        default="auto",
        description="The board's protocol. auto detects it, after stopping the wheels.",
    )
    dtr: bool = Field(
        default=True,
        description="Level of DTR, set before the port opens; the board wires it to its reset.",
    )
    rts: bool = Field(
        default=False,
        description="Level of RTS, set before the port opens; asserted at a reset, it leaves the "
        "board silent.",
    )
    hangup_on_close: bool = Field(
        default=False,
        description="Whether closing the port drops DTR (HUPCL), which may reset the board, and "
        "its counters with it.",
    )


class Guard(Section):
    """The process that stops the wheels of a daemon that no longer can."""

    relay: RelayLine = Field(
        default="",
        description="GPIO line that is toggled ten times a second while the board is heard, for a "
        "relay in the motors' supply: docs/relay.md. Empty: none.",
    )


LOW_CHARGE = 0.1
"""A battery with less is low, if its curve is known."""

BatteryPoint: TypeAlias = Annotated[
    tuple[float, float],
    Field(
        strict=False,
        json_schema_extra={
            "$comment": "a pair [volts, charge from 0 to 1]",
            "items": {"type": "number"},
        },
    ),
]


def _curve_problem(curve: tuple[BatteryPoint, ...]) -> str | None:
    if len(curve) == 1:
        return "one point is no curve; give two at least, or none"
    if any(not 0.0 <= charge <= 1.0 for _, charge in curve):
        return "each charge, the second number of a pair, is from 0 to 1"
    pairs = list(pairwise(curve))
    if any(volts >= next_volts for (volts, _), (next_volts, _) in pairs):
        return "the volts, the first number of each pair, rise from point to point"
    if any(charge > next_charge for (_, charge), (_, next_charge) in pairs):
        return "the charge does not fall while the volts rise"
    return None


def _profile_problem(profile: str) -> str | None:
    if profile == "r2l":
        return "an R2L is an r2"
    if profile == "a1":
        return (
            "the law of an A1's wheels is not published, so yahboomd cannot drive it yet; "
            "docs/boards.md has what is missing, and how to send it"
        )
    if profile.startswith("tt") and profile not in PROFILES:
        return "a TT motor without encoder gives no odometry"
    return None


class Board(Section):
    """The motors that the board is set up for."""

    profile: Annotated[str, Checked("", _profile_problem), Choice((*PROFILES, CUSTOM))] = Field(
        default="520",
        description="The motors: encoder lines, gear ratio and wheel of the vendor's kits. tt is "
        "the TT motor with encoder; without one there is no odometry. x1, x3, x3-plus, "
        "r2 (and R2L), sunrise and m1 are the Rosmaster cars, with the car type that their board "
        "stores. custom takes the figures from the keys below.",
    )
    write_settings: bool = Field(
        default=False,
        description="Whether connecting writes settings that differ from the profile to the "
        "board's flash, while the wheels are at rest, but for its motor or car type. If false, "
        "nothing is written. A different type, or a zero, refuses motion and names `yahboomd probe "
        "--write`.",
    )
    battery_period_s: float = Field(
        default=5.0,
        ge=0.0,
        le=3600.0,
        description="Seconds between requests for the battery's voltage; 0: never.",
    )
    battery_scale: float = Field(
        default=1.0,
        ge=0.8,
        le=1.25,
        description="The true volts per volt that the board reports. Measure at the battery's plug "
        "while the robot stands: an owner's X3 reported 11.2 to 11.3 V of 11.7 V, so 1.04. Status, "
        "page and limits take the corrected volts; a Rosmaster board's own alarm, and what is said "
        "of it, the board's.",
    )
    battery_curve: Annotated[tuple[BatteryPoint, ...], Checked("", _curve_problem)] = Field(
        default=(),
        strict=False,
        description="Charge of the battery by its voltage, rising, for the percentage in ROS 2; "
        "straight lines join the points. Empty: the percentage is unknown. Three lithium-ion cells "
        "in series: [[9.6, 0.0], [10.5, 0.1], [11.1, 0.4], [11.7, 0.7], [12.6, 1.0]].",
    )
    battery_low_v: float | None = Field(
        default=None,
        ge=0.0,
        le=100.0,
        examples=[10.5],
        description="Volts below which the battery is low, by the median of 30 s at rest: event, "
        "status and page warn. Absent: where battery_curve gives 10 %, and never without a curve, "
        "because a motor profile does not know its battery; 0: never.",
    )
    battery_stop_v: float | None = Field(
        default=None,
        gt=0.0,
        le=100.0,
        examples=[9.6],
        description="Volts below which the battery is empty, judged in the same way. No motion is "
        "ended; programs begin none until it is charged, and a person at the keyboard or the page "
        "drives at 0.1 m/s. Absent: never.",
    )
    motor_type: int | None = Field(
        default=None,
        ge=1,
        le=4,
        examples=[1],
        description="For profile custom: the board's motor type, 1 = 520, 2 = 310, 3 = TT with "
        "encoder. Absent: 1.",
    )
    deadzone: int | None = Field(
        default=None,
        ge=0,
        le=3600,
        examples=[1900],
        description="For profile custom: PWM units below which the motor does not turn. "
        "Absent: the value that the board stores.",
    )
    lines: int | None = Field(
        default=None,
        ge=1,
        le=10_000,
        examples=[11],
        description="For profile custom: encoder lines in one turn of the motor's own shaft. "
        "Absent: 11.",
    )
    ratio: float | None = Field(
        default=None,
        ge=1.0,
        le=1000.0,
        examples=[30.0],
        description="For profile custom: turns of the motor in one turn of the wheel. The board "
        "keeps its whole part. Absent: from chassis.ticks_per_revolution.",
    )
    wheel_diameter_mm: float | None = Field(
        default=None,
        ge=1.0,
        le=1000.0,
        examples=[67.0],
        description="For profile custom: diameter of the wheel in millimetres, as the board "
        "stores it. Absent: from chassis.wheel_radius_m.",
    )

    def low_v(self) -> float | None:
        """The volts below which the battery is low; None for never."""
        if self.battery_low_v is not None:
            return self.battery_low_v or None
        for (volts, charge), (next_volts, next_charge) in pairwise(self.battery_curve):
            if charge < LOW_CHARGE <= next_charge:
                share = (LOW_CHARGE - charge) / (next_charge - charge)
                return round(volts + share * (next_volts - volts), 3)
        return self.battery_curve[0][0] if self.battery_curve else None


def _axes_problem(axes: str) -> str | None:
    return axes_problem(axes, rotation=True) if axes else None


def _gyro_axes_problem(axes: str) -> str | None:
    return axes_problem(axes, rotation=False) if axes else None


class Imu(Section):
    """The board's inertial sensor, if it has one: its mounting and calibration.

    Published samples lie along the axes of the base: forward, left, up.
    """

    axes: Annotated[str, Checked("", _axes_problem)] = Field(
        default="",
        description="The sensor's axes that point forward, left and up, such as x -y -z. Empty: "
        "x y z for an MPU9250, x -y -z for an ICM20948, as owners' boards show gravity. The sign "
        "of an ICM20948's gyro is not known for sure: `yahboomd calibrate imu` finds it.",
    )
    gyro_axes: Annotated[str, Checked("", _gyro_axes_problem)] = Field(
        default="",
        description="The same for the gyro, if the board gives it other signs. Empty: as axes. "
        "A positive turn is counter-clockwise, seen from above.",
    )
    gyro_scale: float | None = Field(
        default=None,
        ge=0.5,
        le=2.0,
        examples=[1.0],
        description="The true turn per turn that the gyro shows; calibrated to 0.1 %. "
        "Absent: 1, with the datasheet's tolerance, and used once a clear turn showed the sign.",
    )
    frame_id: Frame = Field(
        default="imu_link", description="Frame of the samples; its axes are those of the base."
    )

    def mounting(self) -> Mounting:
        return Mounting(self.axes, self.gyro_axes, gyro_factor=self.gyro_scale or 1.0)


class MotorEntry(Section):
    """One motor of a wheel."""

    position: int = Field(
        ge=1, le=4, description="Its connector on the board, M1 to M4 (the article's A to D)."
    )
    command_sign: Sign = Field(
        default=1, description="-1 if a positive command turns the wheel backward."
    )
    encoder_sign: Sign = Field(
        default=1, description="-1 if the counts fall while the wheel rolls forward."
    )
    name: MotorName | None = Field(
        default=None,
        description="Its name in messages. Absent: the wheel's name, numbered if the wheel "
        "has several motors.",
    )


MotorEntries: TypeAlias = Annotated[
    tuple[MotorEntry, ...], Field(min_length=1, max_length=4, strict=False)
]


PRESET_NAMES = ("2wd", "4wd", "mecanum", "ackermann")


class Chassis(Section):
    """The geometry of the base, and which motor turns which wheel.

    Wheels are `left` and `right` (differential, skid_steer, ackermann), or `front_left`,
    `rear_left`, `front_right` and `rear_right` (mecanum). Motors that are given
    replace all default motors. With a preset, each replaces the motor of its position, and the
    others stay: `preset = "4wd"` and
    `motors.right = [{ position = 4, command_sign = -1, encoder_sign = -1 }]`.
    """

    preset: Annotated[str, Choice(("", *PRESET_NAMES))] = Field(
        default="",
        description="Sets kinematics and motors in one word. "
        "2wd: the article's, left on M1, right on M3. 4wd: the vendor's, skid steer, M1 left "
        "front, M2 left rear, M3 right front, M4 right rear. mecanum: the same places. ackermann: "
        "a car that steers, rear wheels left on M2, right on M4.",
    )
    kinematics: Annotated[str, Choice((), KINEMATICS)] = Field(
        default="differential",
        description="How the base moves. skid_steer: several motors on each side. ackermann: a car "
        "that steers, driven by its rear wheels.",
    )
    wheel_separation_m: float = Field(
        default=0.150,
        gt=0.0,
        le=5.0,
        description="Metres from the left wheels' middle to the right wheels'.",
    )
    wheel_base_m: float | None = Field(
        default=None,
        gt=0.0,
        le=5.0,
        examples=[0.170],
        description="Metres from the front axle to the rear one; for mecanum and ackermann, which "
        "need it.",
    )
    steering_max_rad: float | None = Field(
        default=None,
        gt=0.0,
        le=1.4,
        examples=[0.785],
        description="For ackermann: the largest angle of the steering, in radians. With the wheel "
        "base it gives the tightest curve. Absent: 0.785, 45 degrees.",
    )
    wheel_radius_m: float | None = Field(
        default=None,
        gt=0.0,
        le=1.0,
        examples=[0.0325],
        description="Metres from the axle to the rim. Absent: the profile's. The article's is "
        "0.0325, the 520 kit's 0.0335.",
    )
    ticks_per_revolution: float | None = Field(
        default=None,
        ge=1.0,
        le=1_000_000.0,
        examples=[1320],
        description="Counts in one turn of the wheel. Absent: the profile's, lines x ratio x 4.",
    )
    command_scale: float = Field(
        default=1.0,
        ge=0.1,
        le=10.0,
        description="The article's SCALE_FACTOR as a multiplier of 1000 units per m/s: above 1 "
        "if the wheels turn slower than commanded.",
    )
    wheel_radius_multiplier: dict[str, Positive] = Field(
        default={"left": 1.0, "right": 1.0},
        description="Calibration of each wheel's radius, by wheel; one that is missing is 1.",
    )
    wheel_separation_multiplier: float = Field(
        default=1.0,
        ge=0.1,
        le=10.0,
        description="Calibration of the track; a skid-steer base acts as if it were 1.3 to 1.9 "
        "times as wide as it is.",
    )
    sideways_multiplier: float = Field(
        default=1.0,
        ge=0.1,
        le=10.0,
        description="Calibration of the way to the side of a mecanum base, for each metre that its "
        "wheels count; slip of the rollers makes it 0.8 to 0.95.",
    )
    break_away_linear_m_s: float = Field(
        default=0.0,
        ge=0.0,
        le=1.0,
        description="The slowest speed at which the base begins to drive on its floor, in m/s, "
        "as `yahboomd calibrate tape` measures it: moves begin and end with it. 0: unknown.",
    )
    break_away_angular_rad_s: float = Field(
        default=0.0, ge=0.0, le=6.0, description="The same for turns in place, in rad/s."
    )
    calibration_file: AnyPath = Field(
        default="",
        description="The file that `yahboomd calibrate` writes and that goes over the "
        "multipliers and the break-away speeds. Empty: calibration.toml in the state directory, "
        "/var/lib/yahboomd for the service.",
    )
    motors: dict[str, MotorEntries] = Field(
        default={"left": (MotorEntry(position=1),), "right": (MotorEntry(position=3),)},
        description="The motors of each wheel.",
    )


PRESETS: dict[str, tuple[str, dict[str, tuple[MotorEntry, ...]]]] = {
    "2wd": (
        "differential",
        {"left": (MotorEntry(position=1),), "right": (MotorEntry(position=3),)},
    ),
    "4wd": (
        "skid_steer",
        {
            "left": (
                MotorEntry(position=1, name="front_left"),
                MotorEntry(position=2, name="rear_left"),
            ),
            "right": (
                MotorEntry(position=3, name="front_right"),
                MotorEntry(position=4, name="rear_right"),
            ),
        },
    ),
    "mecanum": (
        "mecanum",
        {
            "front_left": (MotorEntry(position=1),),
            "rear_left": (MotorEntry(position=2),),
            "front_right": (MotorEntry(position=3),),
            "rear_right": (MotorEntry(position=4),),
        },
    ),
    "ackermann": (
        "ackermann",
        {"left": (MotorEntry(position=2),), "right": (MotorEntry(position=4),)},
    ),
}
"""Kinematics and motors of the known builds: the article's, and the vendor's with four wheels."""


def given_motors(chassis: Chassis) -> dict[str, tuple[MotorEntry, ...]]:
    """The wheels whose motors differ from the default.

    A key from ``--set`` copies the default of its whole table: equal motors were not given.
    """
    default = Chassis().motors
    return {
        wheel: entries for wheel, entries in chassis.motors.items() if entries != default.get(wheel)
    }


def preset_motors(chassis: Chassis) -> dict[str, tuple[MotorEntry, ...]]:
    given = given_motors(chassis)
    return {
        wheel: tuple(
            next(
                (
                    entry if entry.name else entry.model_copy(update={"name": usual.name})
                    for entry in given.get(wheel, ())
                    if entry.position == usual.position
                ),
                usual,
            )
            for usual in entries
        )
        for wheel, entries in PRESETS[chassis.preset][1].items()
    }
