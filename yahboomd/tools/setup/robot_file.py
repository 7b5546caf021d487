"""Writes ``robot.toml``: as text with comments, checked, atomically."""

from __future__ import annotations

import textwrap
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path

from yahboomd.core.atomic_write import write_atomic
from yahboomd.core.config import Config, read
from yahboomd.core.config.values import inline
from yahboomd.core.drive.kinematics import unit_geometry
from yahboomd.core.errors import ConfigError
from yahboomd.core.model import Kinematics
from yahboomd.tools.calibrate.estimates.wiring import WiredMotor, WiringFound
from yahboomd.tools.setup.description import Description

_COMMENTS = {
    "profile": "the motors: encoder lines, gear and wheel",
    "kinematics": "how it moves",
    "wheel_radius_m": "from the axle to the rim",
    "wheel_separation_m": "from the left wheels' middle to the right wheels'",
    "wheel_base_m": "from the front axle to the rear one",
    "ticks_per_revolution": "counts in one turn, as seen: not the profile's",
}


def as_toml(
    description: Description, wiring: WiringFound, *, port: str = "", gear: str = ""
) -> str:
    """The configuration of a robot.

    Args:
        port: The serial port; empty: yahboomd looks for it.
        gear: The sentence about the gear; empty if it fits.
    """
    lines = [
        "# A robot, written by `yahboomd setup`. All other keys have their defaults, which",
        "# `yahboomd config reference` explains. After a change: `yahboomd config check`.",
    ]
    for fault in wiring.faults:
        lines += [f"# {line}" for line in textwrap.wrap(f"To be repaired: {fault.words}", 96)]
    if port:
        lines += ["", "[serial]", f"port = {inline(port)}"]
    lines += ["", *(f"# {line}" for line in textwrap.wrap(gear, 96))]
    lines += ["[board]", *_keys(description.board)]
    chassis = {
        "kinematics": description.kinematics,
        "wheel_radius_m": round(description.wheel_diameter_mm / 2000.0, 6),
        "wheel_separation_m": round(description.wheel_separation_mm / 1000.0, 6),
    }
    if description.wheel_base_mm is not None:
        chassis["wheel_base_m"] = round(description.wheel_base_mm / 1000.0, 6)
    if description.ticks_per_revolution is not None:
        chassis["ticks_per_revolution"] = description.ticks_per_revolution
    lines += ["", "[chassis]", *_keys(chassis)]
    geometry = unit_geometry(description.kinematics)
    if geometry.sides:
        lines += [
            "# Such a base turns as if it were 1.3 to 1.9 times as wide: see `yahboomd calibrate`.",
            "wheel_separation_multiplier = 1.0",
        ]
    lines += [
        "",
        "# Which plug each wheel's motor is in. Both signs are -1 for a motor that is mounted the",
        "# other way round.",
        "[chassis.motors]",
        *_motors(geometry, wiring.motors),
    ]
    return "\n".join(lines) + "\n"


def as_config(description: Description, wheels: Sequence[str]) -> Config:
    """The configuration of a robot with a provisional wiring."""
    motors = tuple(
        WiredMotor(wheel=wheel, position=position, sign=1)
        for position, wheel in enumerate(wheels, start=1)
    )
    text = as_toml(description, WiringFound(motors=motors))
    return Config.model_validate(tomllib.loads(text))


def write_robot(path: Path, text: str, *, overwrite: bool) -> None:
    """Write the file, if the configuration in it can be used.

    Raises:
        ConfigError: It cannot be written, is there already, or cannot be used.
    """
    try:
        # Check the file alone, without the environment or a calibration.
        write_atomic(
            path, text.encode(), check=lambda made: read(made, environ={}), replace=overwrite
        )
    except FileExistsError as error:
        raise ConfigError(
            f"{path} is there already.", remedy="Name another file: `--output FILE`."
        ) from error
    except OSError as error:
        raise ConfigError(
            f"{path} cannot be written: {error.strerror}.",
            remedy="Name another file: `--output FILE`.",
        ) from error


def _keys(table: Mapping[str, object]) -> list[str]:
    rows = [(f"{key} = {inline(value)}", _COMMENTS.get(key, "")) for key, value in table.items()]
    width = max(len(row) for row, _ in rows) + 2
    return [f"{row:<{width}}# {words}" if words else row for row, words in rows]


def _motors(geometry: Kinematics, motors: Sequence[WiredMotor]) -> list[str]:
    if not geometry.sides:
        return [f"{motor.wheel} = [{_entry(motor)}]" for motor in motors]
    lines = []
    for side in geometry.wheels:
        entries = [_entry(motor, named=True) for motor in motors if motor.wheel.endswith(side)]
        lines += [f"{side} = [", *(f"    {entry}," for entry in entries), "]"]
    return lines


def _entry(motor: WiredMotor, *, named: bool = False) -> str:
    parts = [f"position = {motor.position}"]
    if motor.sign < 0:
        parts += ["command_sign = -1", "encoder_sign = -1"]
    if named:
        parts.append(f"name = {inline(motor.wheel)}")
    return f"{{ {', '.join(parts)} }}"
