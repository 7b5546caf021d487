"""From wheels to the four positions of the board: which motor sits where, and which way it turns.

A wheel of the geometry may have several motors (each side of a skid-steer base). Positions that no
motor uses are commanded 0, always.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import msgspec

from yahboomd.errors import ConfigError
from yahboomd.model import CHANNELS, Counts, Kinematics, Motor

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


class Placement(msgspec.Struct, frozen=True, kw_only=True):
    """Where one motor is connected.

    Attributes:
        position: On the board, 1 to 4.
        command_sign: -1 where a positive command would turn the wheel backward.
        encoder_sign: -1 where the counts fall while the wheel rolls forward.
    """

    position: int
    command_sign: int = 1
    encoder_sign: int = 1


def _at(*positions: int) -> tuple[Placement, ...]:
    return tuple(Placement(position=position) for position in positions)


MOTOR_PRESETS: Mapping[str, Mapping[str, tuple[Placement, ...]]] = {
    # The article's two-wheeled base: A is left, C is right, B and D stay 0.
    "article_2wd": {"left": _at(1), "right": _at(3)},
    # The vendor's four-wheeled base: M1 front left, M2 rear left, M3 front right, M4 rear right.
    "vendor_4wd": {"left": _at(1, 2), "right": _at(3, 4)},
    "mecanum": {
        "front_left": _at(1),
        "rear_left": _at(2),
        "front_right": _at(3),
        "rear_right": _at(4),
    },
}
"""Documented wirings: for each wheel of the geometry its motors, front first."""


def build_motors(
    kinematics: Kinematics,
    placements: Mapping[str, Sequence[Placement]],
    *,
    radius_m: float,
    ticks_per_revolution: float,
    radius_multipliers: Mapping[str, float] | None = None,
) -> tuple[Motor, ...]:
    """The motors of a base, in the order of its wheels.

    A wheel's only motor has the wheel's name; two motors of one side are ``front_left`` and
    ``rear_left`` in the order given; more are numbered from 1.

    Args:
        kinematics: The geometry whose wheels they turn.
        placements: For each wheel, its motors, front first.
        radius_m: The nominal radius of the wheels.
        ticks_per_revolution: Counts of one turn of a wheel.
        radius_multipliers: Calibration, by wheel or by side (``left``, ``right``); absent is 1.

    Raises:
        ConfigError: Wheels without motors, motors for wheels that do not exist, a position outside
            1..4 or used twice, a sign that is neither 1 nor -1, or sizes that are not positive. All
            mistakes are named at once.
    """
    problems = _problems(kinematics, placements)
    multipliers = radius_multipliers or {}
    motors: list[Motor] = []
    if not (math.isfinite(ticks_per_revolution) and ticks_per_revolution > 0.0):
        problems.append(f"ticks_per_revolution is {ticks_per_revolution}, not a positive number.")
    for index, wheel in enumerate(kinematics.wheels):
        factor = multipliers.get(wheel, multipliers.get(wheel.rpartition("_")[2], 1.0))
        radius = radius_m * factor
        if not (math.isfinite(radius) and radius > 0.0):
            problems.append(f"The radius of {wheel} is {radius} m, not a positive number.")
        mounted = placements.get(wheel, ())
        motors += [
            Motor(
                name=name,
                wheel=index,
                position=placement.position,
                command_sign=placement.command_sign,
                encoder_sign=placement.encoder_sign,
                radius_m=radius,
                ticks_per_revolution=ticks_per_revolution,
            )
            for name, placement in zip(_names(wheel, len(mounted)), mounted, strict=True)
        ]
    if problems:
        raise ConfigError(" ".join(problems))
    return tuple(motors)


def motor_speeds(motors: Sequence[Motor], speeds: Sequence[float]) -> tuple[float, ...]:
    """The rim speed of each motor's wheel, m/s, positive forward, from the speeds of the wheels."""
    return tuple([speeds[motor.wheel] for motor in motors])


def wheel_limits(
    kinematics: Kinematics,
    motors: Sequence[Motor],
    units_per_m_s: Sequence[float],
    max_command: int,
) -> tuple[float, ...]:
    """The fastest rim speed of each wheel, m/s, that the board's command range can express.

    Args:
        kinematics: The geometry.
        motors: Its motors.
        units_per_m_s: For each motor, command units for 1 m/s at the rim.
        max_command: The largest command, such as 1000.
    """
    limits = [math.inf] * len(kinematics.wheels)
    for motor, units in zip(motors, units_per_m_s, strict=True):
        limits[motor.wheel] = min(limits[motor.wheel], max_command / abs(units))
    return tuple(limits)


def channel_commands(
    motors: Sequence[Motor], speeds: Sequence[float], units_per_m_s: Sequence[float]
) -> Counts:
    """Commands for the four positions: whole units, with each motor's sign; unused positions 0.

    Rounded to the nearest unit. The board's range is not this function's: wheels are desaturated
    before, and the dialect clamps.

    Args:
        motors: The motors.
        speeds: Rim speed of each *wheel*, m/s.
        units_per_m_s: For each motor, command units for 1 m/s at the rim.

    Raises:
        ValueError: A command is not a finite number. Nothing that the bus can send leads here; a
            mistake in the program must end in a stop, not in a number that the board misreads.
    """
    commands = [0] * CHANNELS
    for motor, units in zip(motors, units_per_m_s, strict=True):
        command = speeds[motor.wheel] * units * motor.command_sign
        if not math.isfinite(command):
            raise ValueError(f"The command for {motor.name} is {command}.")
        commands[motor.position - 1] = round(command)
    first, second, third, fourth = commands
    return first, second, third, fourth


def _names(wheel: str, count: int) -> tuple[str, ...]:
    if count == 1:
        return (wheel,)
    if count == 2:
        return f"front_{wheel}", f"rear_{wheel}"
    return tuple(f"{wheel}_{number}" for number in range(1, count + 1))


def _problems(kinematics: Kinematics, placements: Mapping[str, Sequence[Placement]]) -> list[str]:
    problems: list[str] = []
    known = ", ".join(kinematics.wheels)
    problems += [
        f"chassis.motors.{wheel}: a {kinematics.name} base has no such wheel; it has {known}."
        for wheel in placements
        if wheel not in kinematics.wheels
    ]
    problems += [
        f"chassis.motors.{wheel}: no motor turns this wheel."
        for wheel in kinematics.wheels
        if not placements.get(wheel)
    ]
    taken: dict[int, str] = {}
    for wheel, mounted in placements.items():
        for placement in mounted:
            position = placement.position
            if not 1 <= position <= CHANNELS:
                problems.append(
                    f"chassis.motors.{wheel}: position {position} is not on the board (1 to 4)."
                )
            elif position in taken:
                problems.append(
                    f"chassis.motors.{wheel}: position {position} already is {taken[position]}'s."
                )
            taken.setdefault(position, wheel)
            problems += [
                f"chassis.motors.{wheel}: {what} is {sign}, neither 1 nor -1."
                for what, sign in (
                    ("command_sign", placement.command_sign),
                    ("encoder_sign", placement.encoder_sign),
                )
                if sign not in (1, -1)
            ]
    return problems
