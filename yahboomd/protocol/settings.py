"""What the board keeps in its flash, the motors it is sold with, and what follows for commands.

The board counts in what its settings make it believe: the command unit of ``$spd`` is a millimetre
per second *if* lines, ratio and diameter are true. So yahboomd reads them and corrects for them
instead of overwriting them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

import msgspec

from yahboomd.errors import BoardError, ConfigError
from yahboomd.protocol.dialect import Decoded, Setting, SettingValue, VersionLine

EDGES_PER_LINE: Final = 4
"""The board counts both edges of both phases."""

UNITS_PER_M_S: Final = 1000.0
"""Command units of one metre per second where the board's own idea of the wheel is right, and in
the article's dialect always."""

NO_ENCODER_TYPE: Final = 4
"""The stored motor type that means: without encoder."""

MOTOR_TYPES: Final = {1: "520", 2: "310", 3: "TT with encoder", NO_ENCODER_TYPE: "TT, no encoder"}
"""The stored motor types, by number."""

_REMEDY = "Run `yahboomd probe --write` to store the profile."


class BoardSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Stored values; None is a value that is not known, or not wanted.

    Attributes:
        version: The firmware's version, which cannot be written.
        motor_type: 1 to 4, see :data:`MOTOR_TYPES`.
        deadzone: PWM units added to overcome friction, 0 to 3600.
        lines: Encoder lines of one turn of the motor.
        ratio: Gear ratio; the board stores whole numbers only.
        wheel_diameter_mm: Millimetres.
        pid: P, I and D of the speed loop, one set for all motors.
    """

    version: str | None = None
    motor_type: int | None = None
    deadzone: int | None = None
    lines: int | None = None
    ratio: float | None = None
    wheel_diameter_mm: float | None = None
    pid: tuple[float, float, float] | None = None

    @property
    def is_complete(self) -> bool:
        """Whether every value is known: the whole answer has arrived."""
        return None not in msgspec.structs.astuple(self)

    def with_value(self, name: str, value: SettingValue | str) -> BoardSettings:
        """A copy with one more value."""
        return msgspec.structs.replace(self, **{name: value})


class MotorProfile(msgspec.Struct, frozen=True, kw_only=True):
    """A motor with its gear and wheel, as built.

    Attributes:
        name: The word in the configuration.
        motor_type: What the board calls it, 1 to 3.
        deadzone: PWM units; None keeps what the board has.
        lines: Encoder lines of one turn of the motor.
        ratio: The true gear ratio, decimals included.
        wheel_diameter_mm: Millimetres.
    """

    name: str
    motor_type: int
    deadzone: int | None
    lines: int
    ratio: float
    wheel_diameter_mm: float

    @property
    def ticks_per_revolution(self) -> float:
        """Counts of one turn of the wheel."""
        return self.lines * self.ratio * EDGES_PER_LINE

    @property
    def wheel_radius_m(self) -> float:
        """Half the diameter, in metres."""
        return self.wheel_diameter_mm / 2000.0

    @property
    def settings(self) -> BoardSettings:
        """What a board should store for this motor. The speed loop's gains are left alone."""
        return BoardSettings(
            motor_type=self.motor_type,
            deadzone=self.deadzone,
            lines=self.lines,
            ratio=self.ratio,
            wheel_diameter_mm=self.wheel_diameter_mm,
        )


PROFILES: Final[dict[str, MotorProfile]] = {
    name: MotorProfile(
        name=name,
        motor_type=motor_type,
        deadzone=deadzone,
        lines=lines,
        ratio=ratio,
        wheel_diameter_mm=wheel_diameter_mm,
    )
    for name, motor_type, deadzone, lines, ratio, wheel_diameter_mm in (
        ("520", 1, 1900, 11, 30.0, 67.0),
        ("520-1:19", 1, 1900, 11, 19.0, 67.0),
        ("520-1:56", 1, 1900, 11, 56.0, 67.0),
        ("l520", 1, 1900, 11, 40.0, 67.0),
        # Sold as 1:20, and 20 is what the board can store.
        ("310", 2, 1600, 13, 20.409, 48.0),
        ("tt", 3, 1250, 13, 45.0, 68.0),
    )
}
"""The vendor's motors by name. The TT motor without encoder is none of them: no odometry."""


def custom_profile(
    *,
    lines: int,
    ratio: float,
    wheel_diameter_mm: float,
    motor_type: int = 1,
    deadzone: int | None = None,
) -> MotorProfile:
    """The profile ``custom``: a motor that the vendor does not list.

    Raises:
        ConfigError: If the board cannot be sent them, or could not count.
    """
    profile = MotorProfile(
        name="custom",
        motor_type=motor_type,
        deadzone=deadzone,
        lines=lines,
        ratio=ratio,
        wheel_diameter_mm=wheel_diameter_mm,
    )
    if motor_type == NO_ENCODER_TYPE:
        message = "Motor type 4 has no encoder, so there is nothing to compute odometry from."
        raise ConfigError(message)
    check_storable(profile.settings)
    return profile


def check_storable(want: BoardSettings) -> None:
    """Refuse values that the board would accept with OK and then run away with.

    Raises:
        ConfigError: Naming every such value.
    """
    wrong = []
    if want.motor_type is not None and want.motor_type not in MOTOR_TYPES:
        wrong.append(f"motor type {want.motor_type} (1 to 4)")
    if want.deadzone is not None and not 0 <= want.deadzone <= 3600:
        wrong.append(f"dead zone {want.deadzone} (0 to 3600)")
    if want.lines is not None and not 0 < want.lines <= 100_000:
        wrong.append(f"encoder lines {want.lines} (above 0)")
    if want.ratio is not None and not 1.0 <= want.ratio <= 10_000.0:
        wrong.append(f"gear ratio {want.ratio} (1 or more)")
    if want.wheel_diameter_mm is not None and not 1.0 <= want.wheel_diameter_mm <= 10_000.0:
        wrong.append(f"wheel diameter {want.wheel_diameter_mm} mm (1 or more)")
    if want.pid is not None and not all(0.0 <= gain <= 1000.0 for gain in want.pid):
        wrong.append(f"PID gains {want.pid} (0 or more)")
    if wrong:
        raise ConfigError(f"The board must not store {', '.join(wrong)}.")


def board_settings(items: Iterable[Decoded], known: BoardSettings | None = None) -> BoardSettings:
    """Gather the lines of the stored settings; anything else is passed over.

    Args:
        items: What was decoded while the answer came in.
        known: What earlier lines have said.
    """
    settings = known or BoardSettings()
    for item in items:
        if isinstance(item, Setting):
            settings = settings.with_value(item.name, item.value)
        elif isinstance(item, VersionLine):
            settings = settings.with_value("version", item.version)
    return settings


def problems(settings: BoardSettings, profile: MotorProfile) -> tuple[str, ...]:
    """Why this board must not be moved as it is set up; empty where nothing forbids it.

    Lines, ratio and diameter that merely differ from the profile are no problem, since
    :func:`units_per_m_s` corrects for them; zeros and a wrong type make wheels run away.

    Returns:
        A sentence for each reason, with the remedy.
    """
    found = []
    essential = {
        "encoder lines": settings.lines,
        "gear ratio": settings.ratio,
        "wheel diameter": settings.wheel_diameter_mm,
    }
    for what, value in essential.items():
        if value is None:
            found.append(f"The board did not show its {what}; read its settings again.")
        elif value <= 0:
            found.append(
                f"The board stores {value:g} as its {what}: a wheel would run away. {_REMEDY}"
            )
    if settings.motor_type is None:
        found.append("The board did not show its motor type; read its settings again.")
    elif settings.motor_type != profile.motor_type:
        found.append(
            f"The board is set to motor type {settings.motor_type}"
            f" ({MOTOR_TYPES.get(settings.motor_type, 'unknown')}), the profile {profile.name}"
            f" needs {profile.motor_type} ({MOTOR_TYPES.get(profile.motor_type, 'unknown')}):"
            f" a wheel would run away. {_REMEDY}"
        )
    return tuple(found)


def units_per_m_s(
    settings: BoardSettings | None,
    *,
    radius_m: float,
    ticks_per_revolution: float,
    scale: float,
) -> float:
    """Command units that make a rim run at one metre per second.

    The board turns a command of U mm/s into U / (pi D) * lines * ratio * 4 counts a second, with
    its stored values; the wheel needs ticks / (2 pi r) counts a second for 1 m/s, with the true
    ones. Equal counts give U.

    Args:
        settings: What the board stores; None where it stores nothing (the article's dialect).
        radius_m: The wheel's true radius.
        ticks_per_revolution: The wheel's true counts per turn.
        scale: The calibration multiplier of commands.

    Raises:
        BoardError: If lines, ratio or diameter are unknown or zero; see :func:`problems`.
    """
    if settings is None:
        return UNITS_PER_M_S * scale
    lines, ratio, diameter_mm = settings.lines, settings.ratio, settings.wheel_diameter_mm
    if not lines or not ratio or not diameter_mm or min(lines, ratio, diameter_mm) < 0:
        message = "The board's encoder lines, gear ratio and wheel diameter are not all known."
        raise BoardError(message, remedy=_REMEDY)
    ticks_per_m = ticks_per_revolution / (2.0 * math.pi * radius_m)
    board_mm_per_tick = math.pi * diameter_mm / (lines * ratio * EDGES_PER_LINE)
    return ticks_per_m * board_mm_per_tick * scale
