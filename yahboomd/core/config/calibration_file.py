"""The file that `yahboomd calibrate` writes: a layer over ``config.toml``, with its origin.

It is valid for the robot that it was made for. It has the wheels' nominal size, their distance and
their counts; if the configuration differs, it is ignored with a warning.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, TypeAlias

from pydantic import Field, ValidationError

from yahboomd.core.config.models import Config
from yahboomd.core.config.reading import read_named
from yahboomd.core.config.values import Section, inline
from yahboomd.core.errors import ConfigError

LARGEST_BYTES = 100_000

Multiplier: TypeAlias = Annotated[float, Field(ge=0.1, le=10.0)]

Speed: TypeAlias = Annotated[float, Field(ge=0.0, le=6.0)]


class Geometry(Section):
    """The robot that a calibration was made for, as configured."""

    kinematics: str
    wheel_separation_m: float
    wheel_radius_m: float
    ticks_per_revolution: float
    wheel_base_m: float | None = None
    """Only of a mecanum base, whose turns depend on it."""


class Multipliers(Section):
    """The keys of ``[chassis]`` that are calibrated."""

    wheel_radius_multiplier: dict[str, Multiplier]
    wheel_separation_multiplier: Multiplier
    sideways_multiplier: Multiplier | None = None
    """Only of a mecanum base."""
    break_away_linear_m_s: Speed | None = None
    break_away_angular_rad_s: Speed | None = None
    """Only if they were measured: by tape."""


class Calibration(Section):
    """One calibration.

    Attributes:
        made: The date, and the time of day in UTC.
        method: How it was measured, in a few words.
        residual: The error that remains, in words for people.
        before: The multipliers that it replaced.
    """

    made: str
    method: str
    residual: str
    geometry: Geometry
    chassis: Multipliers
    before: Multipliers


def geometry_of(config: Config) -> Geometry:
    kinematics = config.kinematics()
    # The separation of a mecanum base is measured together with its axles.
    turns_by_base = kinematics.holonomic and kinematics.base_m
    return Geometry(
        kinematics=config.kinematics_name(),
        wheel_base_m=config.chassis.wheel_base_m if turns_by_base else None,
        wheel_separation_m=config.chassis.wheel_separation_m,
        wheel_radius_m=config.chassis.wheel_radius_m or config.profile().wheel_radius_m,
        ticks_per_revolution=config.ticks_per_revolution(),
    )


def read_calibration(path: Path) -> Calibration:
    """Read a calibration file.

    Raises:
        ConfigError: It cannot be used; the message has the reason.
    """
    try:
        raw = read_named(path, LARGEST_BYTES, wait_s=0.0)
        return Calibration.model_validate(tomllib.loads(raw.decode()))
    except OSError as error:
        raise ConfigError(f"{path} cannot be read: {error.strerror}.") from error
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(map(str, first["loc"]))
        raise ConfigError(f"{path} is no calibration: {place}: {first['msg']}.") from error
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path} is no calibration: {error}.") from error


def difference(calibration: Calibration, config: Config) -> str:
    """The part of the robot that changed since, in words; empty if none did."""
    then, now = calibration.geometry, geometry_of(config)
    changed = [
        f"chassis.{name} was {inline(getattr(then, name))} and is {inline(getattr(now, name))}"
        for name in vars(then)
        if getattr(then, name) not in (getattr(now, name), None)
    ]
    return "; ".join(changed)
