"""From wheels to the four positions of the board: which motor sits where, and which way it turns.

A wheel of the geometry may have several motors (each side of a skid-steer base). Positions that no
motor uses are commanded 0, always.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from yahboomd.model import CHANNELS, Counts, Kinematics, Motor

if TYPE_CHECKING:
    from collections.abc import Sequence


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
