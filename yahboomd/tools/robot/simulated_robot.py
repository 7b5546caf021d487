"""Builds the simulated robot that fits a configuration: its motors, wheels and chassis."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import msgspec

from yahboomd.core.protocol.profiles import EDGES_PER_LINE
from yahboomd.simulation.boards import BOARDS
from yahboomd.simulation.options import Corner, DriveName, SimulationOptions, Wiring

if TYPE_CHECKING:
    from yahboomd.core.config import Config


def as_configured(config: Config, base: SimulationOptions | None = None) -> SimulationOptions:
    """A simulated robot with the values of a configuration, calibration included.

    Args:
        base: Values that the configuration lacks; None for the usual robot.
    """
    base = base or SimulationOptions()
    profile, kinematics = config.profile(), config.kinematics()
    radius_m = config.chassis.wheel_radius_m or profile.wheel_radius_m
    configured = config.serial.dialect
    dialect = base.dialect if configured == "auto" else configured
    return msgspec.structs.replace(
        base,
        dialect=dialect,
        drive=cast(DriveName, kinematics.name),
        wiring=tuple(
            Wiring(
                name=motor.name,
                position=motor.position,
                # The geometry names its wheels by their places.
                corner=cast(Corner, kinematics.wheels[motor.wheel]),
                command_sign=motor.command_sign,
                encoder_sign=motor.encoder_sign,
                radius_scale=motor.radius_m / radius_m,
            )
            for motor in config.motors()
        ),
        motor_type=cast(int, profile.stored.get("motor_type", base.motor_type)),
        lines=profile.lines,
        ratio=config.ticks_per_revolution() / (profile.lines * EDGES_PER_LINE),
        wheel_radius_m=radius_m,
        wheel_separation_m=config.chassis.wheel_separation_m
        * config.chassis.wheel_separation_multiplier,
        wheel_base_m=config.chassis.wheel_base_m or base.wheel_base_m,
        sideways=config.chassis.sideways_multiplier,
        flash=BOARDS[dialect].stored({**profile.settings, "ratio": int(profile.ratio)}),
    )
