"""The settings that the 4-channel motor driver stores, and their meaning for its wheels.

The board converts by its settings: the command unit of ``$spd`` is a millimetre per second *if*
lines, ratio and diameter are true.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Final

from yahboomd.core.errors import BoardError
from yahboomd.core.model import Kinematics, Motor
from yahboomd.core.protocol.dialect import Dialect, Findings
from yahboomd.core.protocol.four_channel.framing import RESYNC, LineFramer
from yahboomd.core.protocol.per_motor import PerMotor, per_motor
from yahboomd.core.protocol.profiles import EDGES_PER_LINE, PROFILES, MotorProfile
from yahboomd.core.protocol.settings import (
    BoardSettings,
    SettingValue,
    StoredSetting,
    useless_gains,
)

TITLE: Final = "Yahboom 4-channel motor driver"

MAX_SPEED: Final = 1000
"""Both dialects take speeds up to this, about mm/s."""

UNITS_PER_M_S: Final = 1000.0
"""Command units of one metre per second if the board's settings fit the wheel, and in the article's
dialect always."""

MOTOR_TYPES: Final = {1: "520", 2: "310", 3: "TT with encoder", 4: "TT, no encoder"}
"""The stored motor types, by number."""

_STORE_S: Final = 0.4
"""Storing a value takes 65 to 116 ms, deaf for most of it; a tight wait loses answers."""

_RESET_S: Final = 1.0
"""New gains take up to 350 ms, with a restart."""

_REMEDY: Final = "Run `yahboomd probe --write` to store the profile."


# Two values differ if the board prints them differently: whole, or with three decimals.


def _whole(value: SettingValue) -> str:
    return str(round(_number(value)))


def _gains(value: SettingValue) -> str:
    assert isinstance(value, tuple)
    return ",".join(f"{gain:.3f}" for gain in value)


def _number(value: SettingValue) -> float:
    assert isinstance(value, int | float)
    return value


def _ratio_shown(value: SettingValue) -> str:
    ratio = _number(value)
    return f"{ratio:g}" if ratio == round(ratio) else f"{round(ratio)} (truly {ratio:g})"


def _gains_shown(value: SettingValue) -> str:
    assert isinstance(value, tuple)
    return ", ".join(f"{gain:g}" for gain in value)


def _frame(command: str) -> Callable[[str], bytes]:
    return lambda text: f"${command}:{text}#".encode("ascii")


TABLE: Final = (
    StoredSetting(
        field="motor_type",
        command="mtype",
        label="motor type",
        least=1,
        most=4,
        limits="1 to 4",
        wire=_whole,
        frame=_frame("mtype"),
        shown=lambda value: f"{value:g} ({MOTOR_TYPES.get(round(_number(value)), 'unknown')})",
        steers=True,
        timeout_s=_STORE_S,
    ),
    StoredSetting(
        field="deadzone",
        command="deadzone",
        label="dead zone",
        least=0,
        most=3600,
        limits="0 to 3600",
        wire=_whole,
        frame=_frame("deadzone"),
        timeout_s=_STORE_S,
    ),
    StoredSetting(
        field="lines",
        command="mline",
        label="encoder lines",
        least=1,
        most=65_534,
        limits="1 to 65534",
        wire=_whole,
        frame=_frame("mline"),
        steers=True,
        timeout_s=_STORE_S,
    ),
    StoredSetting(
        field="ratio",
        command="mphase",
        label="gear ratio",
        least=1.0,
        most=10_000.0,
        limits="1 or more",
        wire=_whole,
        frame=_frame("mphase"),
        shown=_ratio_shown,
        steers=True,
        timeout_s=_STORE_S,
    ),
    StoredSetting(
        field="wheel_diameter_mm",
        command="wdiameter",
        label="wheel diameter",
        unit=" mm",
        least=1.0,
        most=10_000.0,
        limits="1 or more",
        wire=lambda value: f"{_number(value):.3f}",
        frame=_frame("wdiameter"),
        steers=True,
        timeout_s=_STORE_S,
    ),
    StoredSetting(
        field="pid",
        command="MPID",
        label="gains P, I, D",
        least=0.0,
        most=1000.0,
        limits="0 or more",
        wire=_gains,
        frame=_frame("MPID"),
        shown=_gains_shown,
        parts=("p", "i", "d"),
        timeout_s=_RESET_S,
        resets=True,
        option="with --write: the gains of the board's speed loop, too (the vendor's: "
        "0.8,0.06,0.5); the board restarts",
    ),
)
"""The stored settings; the gains, which restart the board, last."""


def findings(settings: BoardSettings, profile: MotorProfile) -> Findings:
    """The meaning of the stored settings for these motors.

    Lines, ratio and diameter that merely differ from the profile are no problem, because
    :func:`units_per_m_s` corrects for them; zeros and a wrong type make wheels run away.
    """
    return Findings(
        unfit=tuple(_unfit(settings, profile)),
        wrong=tuple(useless_gains(settings)),
        advice=tuple(_other_profiles(settings, profile)),
    )


def _unfit(settings: BoardSettings, profile: MotorProfile) -> Iterator[str]:
    for row in TABLE:
        value = settings.get(row.field)
        if not row.steers:
            continue
        if value is None:
            yield f"The board did not show its {row.label}; read its settings again."
        elif row.field == "motor_type":
            needed = profile.stored.get(row.field)
            if needed is None:
                yield (
                    f"The board is a {TITLE}, the motors of the profile {profile.name} belong to "
                    "another one. Set board.profile to your motors'."
                )
            elif value != needed:
                yield (
                    f"The board is set to motor type {row.words(value)}, the profile "
                    f"{profile.name} needs {row.words(needed)}: a wheel would run away. Set "
                    "board.profile to the motors that it drives. Only if the board was set up for "
                    "others, store their type with `yahboomd probe --write`."
                )
        elif not _number(value) > 0:
            yield (
                f"The board stores {value:g} as its {row.label}: a wheel would run away. {_REMEDY}"
            )


def _other_profiles(settings: BoardSettings, profile: MotorProfile) -> Iterator[str]:
    if settings.get("motor_type") == profile.stored.get("motor_type"):
        return
    stored = tuple(settings.get(field) for field in ("motor_type", "lines", "ratio"))
    for name, other in PROFILES.items():
        if stored == (other.stored.get("motor_type"), other.lines, round(other.ratio)):
            yield (
                f"The board's settings fit the profile {name}: if those are the motors, do not "
                f'store anything, but set board.profile = "{name}".'
            )


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
        settings: The stored settings; None if the board stores nothing (the article's dialect).
        radius_m: The wheel's true radius.
        ticks_per_revolution: The wheel's true counts per turn.
        scale: The calibration multiplier of commands.

    Raises:
        BoardError: If lines, ratio or diameter are unknown or zero; see :func:`findings`.
    """
    if settings is None:
        return UNITS_PER_M_S * scale
    figures = [settings.get(field) for field in ("lines", "ratio", "wheel_diameter_mm")]
    lines, ratio, diameter_mm = [each if isinstance(each, int | float) else 0.0 for each in figures]
    if not all(figure > 0.0 for figure in (lines, ratio, diameter_mm)):
        message = "The board's encoder lines, gear ratio and wheel diameter are not all known."
        raise BoardError(message, remedy=_REMEDY)
    ticks_per_m = ticks_per_revolution / (2.0 * math.pi * radius_m)
    board_mm_per_tick = math.pi * diameter_mm / (lines * ratio * EDGES_PER_LINE)
    return ticks_per_m * board_mm_per_tick * scale


class FourChannel(Dialect, frozen=True, kw_only=True):
    """What both dialects of this board have in common."""

    title: str = TITLE
    resync: bytes = RESYNC
    # From the last byte of a question to the first of a velocity, unless an answer came before: the
    # board has answered by then (isolated commands at this distance: none lost).
    question_spacing_ns: int = 20_000_000
    # The board clears its mailbox after an answer, a moment after the last byte.
    answer_spacing_ns: int = 2_000_000
    baudrate: int = 115_200
    usb_ids: tuple[str, ...] = ("1a86:7523", "1a86:7522")
    fastest_m_s: float = MAX_SPEED / 1000.0

    def framer(self) -> LineFramer:
        return LineFramer()

    def motion(
        self,
        kinematics: Kinematics,
        motors: tuple[Motor, ...],
        settings: BoardSettings | None,
        *,
        scale: float,
    ) -> PerMotor:
        units = tuple(
            units_per_m_s(
                settings,
                radius_m=motor.radius_m,
                ticks_per_revolution=motor.ticks_per_revolution,
                scale=scale,
            )
            for motor in motors
        )
        return per_motor(kinematics, motors, units, MAX_SPEED)
