"""Whether a board fits the configured robot, and in which units its wheels are commanded."""

from __future__ import annotations

import msgspec

from yahboomd.drive.channels import wheel_limits
from yahboomd.errors import BoardError
from yahboomd.link.handshake import Identity
from yahboomd.model import Kinematics, Motor
from yahboomd.protocol.settings import MotorProfile, problems, units_per_m_s


class Fit(msgspec.Struct, frozen=True, kw_only=True):
    """What follows from a board's settings.

    Attributes:
        units: For each motor, command units for 1 m/s at the rim; empty where it must not move.
        wheel_limits: The fastest that each wheel can be commanded to turn, m/s.
        wrong: Why its wheels must not turn, a sentence each with the remedy; empty where they may.
    """

    units: tuple[float, ...]
    wheel_limits: tuple[float, ...]
    wrong: tuple[str, ...] = ()


def no_board(kinematics: Kinematics) -> Fit:
    """The fit while no board is there: nothing can be commanded."""
    return Fit(units=(), wheel_limits=(0.0,) * len(kinematics.wheels))


def fit(
    identity: Identity,
    *,
    kinematics: Kinematics,
    motors: tuple[Motor, ...],
    profile: MotorProfile,
    scale: float,
) -> Fit:
    """Hold a board against the configuration.

    Args:
        identity: The board's answers.
        kinematics: The drive geometry.
        motors: The configured motors.
        profile: Their kind.
        scale: The calibration multiplier of commands.
    """
    settings = identity.settings
    nothing = no_board(kinematics)
    wrong = problems(settings, profile) if settings is not None else ()
    if wrong:
        return msgspec.structs.replace(nothing, wrong=wrong)
    try:
        units = tuple(
            units_per_m_s(
                settings,
                radius_m=motor.radius_m,
                ticks_per_revolution=motor.ticks_per_revolution,
                scale=scale,
            )
            for motor in motors
        )
    except BoardError as error:
        return msgspec.structs.replace(nothing, wrong=(str(error),))
    limits = wheel_limits(kinematics, motors, units, identity.dialect.max_command)
    return Fit(units=units, wheel_limits=limits)
