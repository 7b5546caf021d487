"""Speeds of wheels as speeds of the motors of a board that takes one for each of four positions.

A wheel of the geometry may have several motors (each side of a skid-steer base). Positions that no
motor uses are commanded 0, always.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from yahboomd.core.model import CHANNELS, Counts, Kinematics, Motor


class PerMotor(msgspec.Struct, frozen=True, kw_only=True):
    """A :class:`~yahboomd.core.protocol.dialect.Motion` of four speeds.

    Attributes:
        units_per_m_s: For each motor, command units for 1 m/s at the rim.
    """

    motors: tuple[Motor, ...]
    units_per_m_s: tuple[float, ...]
    wheel_limits: tuple[float, ...]

    def units(self, speeds: Sequence[float]) -> Counts:
        """Whole units for the four positions, with each motor's sign; unused positions 0.

        Rounded to the nearest unit. Not limited to the board's range: wheels are desaturated
        before, and the dialect clamps.
        """
        commands = [0] * CHANNELS
        for motor, units in zip(self.motors, self.units_per_m_s, strict=True):
            command = speeds[motor.wheel] * units * motor.command_sign
            if not math.isfinite(command):
                raise ValueError(f"The command for {motor.name} is {command}.")
            commands[motor.position - 1] = round(command)
        first, second, third, fourth = commands
        return first, second, third, fourth


def per_motor(
    kinematics: Kinematics,
    motors: tuple[Motor, ...],
    units_per_m_s: tuple[float, ...],
    max_command: int,
) -> PerMotor:
    """The motion of these motors.

    Args:
        max_command: The largest command, such as 1000.
    """
    limits = [math.inf] * len(kinematics.wheels)
    for motor, units in zip(motors, units_per_m_s, strict=True):
        limits[motor.wheel] = min(limits[motor.wheel], max_command / abs(units))
    return PerMotor(motors=motors, units_per_m_s=units_per_m_s, wheel_limits=tuple(limits))
