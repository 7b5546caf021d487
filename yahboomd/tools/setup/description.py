"""Asks for the robot's motors, its drive, and its size."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import msgspec

from yahboomd.core.config import Config
from yahboomd.core.config.hardware import CUSTOM
from yahboomd.core.drive.kinematics import KINEMATICS, unit_geometry
from yahboomd.core.protocol.dialect import Dialect
from yahboomd.core.protocol.profiles import NOTES, PROFILES, MotorProfile
from yahboomd.core.protocol.settings import BoardSettings
from yahboomd.tools.terminal.asking import read_number
from yahboomd.tools.terminal.terminal_questions import Respondent, say, say_heading

DRIVES = {
    "differential": "a wheel or a track on each side, and castors",
    "skid_steer": "four wheels that do not steer; it slips in turns",
    "mecanum": "four wheels with rollers; it drives sideways too",
    "ackermann": "a car: the rear wheels drive, the front wheels steer",
}
"""Drive geometries in words for their owner; others are listed by name only."""

LONGEST_MM = 5000.0
"""The largest distance between two wheels that a configuration accepts."""


class Given(msgspec.Struct, frozen=True, kw_only=True):
    """Answers that were given as options of the command, and are not asked for."""

    profile: str | None = None
    kinematics: str | None = None
    wheel_diameter_mm: float | None = None
    wheel_separation_mm: float | None = None
    wheel_base_mm: float | None = None


class Description(msgspec.Struct, frozen=True, kw_only=True):
    """The robot, but for its wiring.

    Attributes:
        board: The keys of ``[board]``.
        wheel_base_mm: From the front axle to the rear one, if the geometry needs it.
        ticks_per_revolution: Counts in one turn of the wheel, if they are not the profile's.
    """

    board: Mapping[str, Any]
    profile: MotorProfile
    kinematics: str
    wheel_diameter_mm: float
    wheel_separation_mm: float
    wheel_base_mm: float | None = None
    ticks_per_revolution: float | None = None


async def ask_motors(
    person: Respondent, given: Given, dialect: Dialect, stored: BoardSettings | None
) -> tuple[dict[str, Any], MotorProfile]:
    """Ask for the motors; return the keys of ``[board]``, and their profile.

    Args:
        dialect: The board's dialect, which determines the profiles to choose from.
        stored: The board's settings, which mark the profile that it is set up for.
    """
    name = given.profile
    if name is None:
        fields = {row.field for row in dialect.settings}
        names = [
            each for each, profile in PROFILES.items() if not fields or fields & {*profile.stored}
        ]
        say("Which motors does it have? See their sticker, or the page of the kit.")
        rows = [(each, _motor_words(PROFILES[each], stored)) for each in names]
        name = await choose(person, "Motors:", [*rows, (CUSTOM, "another motor")])
    board: dict[str, Any] = {"profile": name}
    if name == CUSTOM:
        board |= await _custom(person, given, stored)
    return board, Config.model_validate({"board": board}).profile()


async def ask_robot(
    person: Respondent, given: Given, board: Mapping[str, Any], profile: MotorProfile
) -> Description:
    """How it drives, and its size."""
    kinematics = given.kinematics
    if kinematics is None:
        say_heading("How it drives")
        kinematics = await choose(
            person, "Drive:", [(name, DRIVES.get(name, "")) for name in KINEMATICS]
        )
    if None in {given.wheel_diameter_mm, given.wheel_separation_mm}:
        say_heading("Its size")
    diameter = await _millimetres(
        person,
        given.wheel_diameter_mm,
        "Diameter of the driven wheels, mm",
        blank=profile.wheel_diameter_mm,
        most=1000.0,
    )
    separation = await _millimetres(
        person,
        given.wheel_separation_mm,
        "From the middle of the left wheels to the middle of the right ones, mm",
    )
    base = None
    if unit_geometry(kinematics).base_m:
        base = await _millimetres(
            person, given.wheel_base_mm, "From the front axle to the rear one, mm"
        )
    return Description(
        board=board,
        profile=profile,
        kinematics=kinematics,
        wheel_diameter_mm=diameter,
        wheel_separation_mm=separation,
        wheel_base_mm=base,
    )


async def choose(person: Respondent, question: str, rows: Sequence[tuple[str, str]]) -> str:
    """Ask for one of several, by its number or its name.

    Args:
        rows: Names, and their meanings.
    """
    width = max(len(name) for name, _ in rows)
    for number, (name, words) in enumerate(rows, start=1):
        say(f"  {number:>2}  {name:<{width}}  {words}".rstrip())
    names = [name for name, _ in rows]
    numbers = {str(number): name for number, name in enumerate(names, start=1)}
    while True:
        answer = (await person.line(f"{question} (1 to {len(rows)})")).lower()
        # A name may look like a number: 520 and 310 are both.
        if answer in names:
            return answer
        if answer in numbers:
            return numbers[answer]
        say(f"There is no {answer!r}." if answer else "A number, please.")


def possible(names: Collection[str]) -> str:
    """The names, for the help of an option."""
    return ", ".join(names)


def _motor_words(profile: MotorProfile, stored: BoardSettings | None) -> str:
    words = (
        f"gear 1:{profile.ratio:g}, {profile.lines} lines, "
        f"wheels of {profile.wheel_diameter_mm:g} mm"
    )
    words += f" ({NOTES[profile.name]})" if profile.name in NOTES else ""
    wanted = {field: profile.settings[field] for field in profile.settings if field != "deadzone"}
    pairs = [(value, (stored or {}).get(field)) for field, value in wanted.items()]
    known = [
        # The board stores a ratio without its decimals.
        math.floor(value) <= has < math.floor(value) + 1
        for value, has in pairs
        if isinstance(value, int | float) and isinstance(has, int | float)
    ]
    return f"{words}   (as the board is set up)" if known and all(known) else words


async def _custom(person: Respondent, given: Given, stored: BoardSettings | None) -> dict[str, Any]:
    def usual(field: str) -> float | None:
        value = (stored or {}).get(field)
        return value if isinstance(value, int | float) and value > 0 else None

    lines = await _figure(
        person, "Encoder lines of one turn of the motor's own shaft", usual("lines"), 10_000
    )
    ratio = await _figure(
        person, "Turns of the motor in one turn of the wheel (30 for 1:30)", usual("ratio"), 1000
    )
    diameter = await _millimetres(
        person,
        given.wheel_diameter_mm,
        "Diameter of the driven wheels, mm",
        blank=usual("wheel_diameter_mm"),
        most=1000.0,
    )
    board = {"lines": round(lines), "ratio": float(ratio), "wheel_diameter_mm": diameter}
    if (motor_type := usual("motor_type")) is not None:
        board["motor_type"] = int(motor_type)
    return board


async def _millimetres(
    person: Respondent,
    given: float | None,
    question: str,
    *,
    blank: float | None = None,
    most: float = LONGEST_MM,
) -> float:
    if given is not None:
        return given
    return await _figure(person, question, blank, most)


async def _figure(person: Respondent, question: str, blank: float | None, most: float) -> float:
    default = "" if blank is None else f" (Enter: {blank:g})"
    while True:
        text = await person.line(f"{question}{default}:")
        if not text and blank is not None:
            return blank
        if (value := read_number(text, lambda number: 1.0 <= number <= most)) is not None:
            return value
        say(f"A number from 1 to {most:g}, please.")
