"""The abilities of a base, and the limits of one move: the configured ones, or lower ones."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import msgspec

from yahboomd.client.move_messages import Move
from yahboomd.core.drive.kinematics import KINEMATICS, unit_geometry
from yahboomd.moves.motion.speed_profile import SpeedLimits

SPEED_M_S, TURN_RAD_S = 0.3, 1.5
ACCELERATION_M_S2, ACCELERATION_RAD_S2 = 0.6, 3.0
JERK_M_S3, JERK_RAD_S3 = 4.0, 20.0
"""The limits of a move that sets none."""

NARROWEST = 1.1
"""A car's curves are planned this much wider than its tightest, so that it can correct."""


class Base(msgspec.Struct, frozen=True, kw_only=True):
    """The properties of a base that moves depend on.

    Attributes:
        holonomic: Whether it moves sideways.
        least_radius_m: The tightest curve of a car that steers; 0 for a base that turns in place.
        way: The configured limits of the speed; ``inf`` for none.
        turn: The same for turns.
        slowest: The slowest speed that starts it ahead, to the left and turning; 0 if unknown.
    """

    holonomic: bool = False
    least_radius_m: float = 0.0
    way: SpeedLimits
    turn: SpeedLimits
    slowest: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def turns(self) -> bool:
        """Whether it turns in place."""
        return self.least_radius_m == 0.0


def base_of(config: Mapping[str, Any]) -> Base:
    """Read the base from the configuration that a daemon's service returns."""
    chassis, limits = config["chassis"], config["limits"]
    kinematics = chassis["kinematics"]
    holonomic = kinematics in KINEMATICS and unit_geometry(kinematics).holonomic
    radius = 0.0
    if kinematics in KINEMATICS and unit_geometry(kinematics).least_radius_m:
        steering = chassis.get("steering_max_rad") or math.pi / 4.0
        radius = float(chassis["wheel_base_m"]) / math.tan(steering)
    way, turn = (
        float(chassis.get(f"break_away_{name}", 0.0)) for name in ("linear_m_s", "angular_rad_s")
    )
    return Base(
        slowest=(way, way, turn),
        holonomic=holonomic,
        least_radius_m=radius,
        way=_configured(limits["linear"]),
        turn=_configured(limits["angular"]),
    )


def _configured(axis: Mapping[str, Any]) -> SpeedLimits:
    def of(name: str) -> float:
        value = axis.get(name)
        return math.inf if value is None else float(value)

    return SpeedLimits(
        speed=of("velocity"),
        acceleration=min(of("acceleration"), of("deceleration")),
        braking=of("deceleration"),
        jerk=of("jerk"),
    )


def way_limits(move: Move, base: Base) -> SpeedLimits:
    """The limits of a move along a way."""
    return _lower(
        base.way,
        speed=move.speed_m_s or SPEED_M_S,
        acceleration=move.acceleration_m_s2 or ACCELERATION_M_S2,
        jerk=move.jerk_m_s3 or JERK_M_S3,
    )


def turn_limits(move: Move, base: Base) -> SpeedLimits:
    """The limits of a move's turns in place."""
    return _lower(
        base.turn,
        speed=move.turn_rad_s or TURN_RAD_S,
        acceleration=move.acceleration_rad_s2 or ACCELERATION_RAD_S2,
        jerk=move.jerk_rad_s3 or JERK_RAD_S3,
    )


def _lower(
    configured: SpeedLimits, *, speed: float, acceleration: float, jerk: float
) -> SpeedLimits:
    acceleration = min(acceleration, configured.acceleration)
    return SpeedLimits(
        speed=min(speed, configured.speed),
        acceleration=acceleration,
        braking=min(4.0 * acceleration, configured.braking),
        jerk=min(jerk, configured.jerk),
    )
