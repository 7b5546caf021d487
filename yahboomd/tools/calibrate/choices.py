"""The choices of each calibration: the options of the command, and the fields of the page's form.

The bounds are the page's. A person at the terminal may choose any positive number.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, TypeAlias

import msgspec
from msgspec import Meta, field, inspect

_Straight: TypeAlias = Annotated[
    float, Meta(ge=0.2, le=20.0, description="straight run", extra={"unit": "m"})
]


class DrivenRuns(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What both calibrations by a tape measure have in common."""

    speed_m_s: Annotated[
        float, Meta(ge=0.02, le=1.0, description="speed", extra={"unit": "m/s", "more": True})
    ] = field(default=0.2, name="speed")
    turn_rad_s: Annotated[
        float, Meta(ge=0.1, le=3.0, description="turning", extra={"unit": "rad/s", "more": True})
    ] = field(default=0.8, name="turn-speed")
    by_hand: Annotated[
        bool, Meta(description="push it by hand: it drives nothing", extra={"more": True})
    ] = field(default=False, name="by-hand")
    dry_run: Annotated[
        bool, Meta(description="show the result, write nothing", extra={"more": True})
    ] = field(default=False, name="dry-run")


class TapeRuns(DrivenRuns, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A straight, turns in place, and ways to the side of a mecanum base."""

    straight_m: _Straight = field(default=2.0, name="straight")
    turns: Annotated[int, Meta(ge=1, le=50, description="turns in place each way")] = 5
    sideways_m: Annotated[
        float,
        Meta(
            ge=0.2,
            le=5.0,
            description="to each side (mecanum wheels)",
            extra={"unit": "m", "more": True},
        ),
    ] = field(default=1.0, name="sideways")


class SquareRuns(DrivenRuns, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Squares in both directions, and a straight."""

    side_m: Annotated[
        float, Meta(ge=0.2, le=10.0, description="side of a square", extra={"unit": "m"})
    ] = field(default=2.0, name="side")
    count: Annotated[int, Meta(ge=1, le=50, description="squares each way")] = 5
    straight_m: _Straight = field(default=5.0, name="straight")


class HandTurns(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Turns by hand, which show how the inertial sensor is mounted."""

    turns: Annotated[int, Meta(ge=1, le=50, description="turns to the left")] = 5


Choices: TypeAlias = TapeRuns | SquareRuns | HandTurns

CALIBRATIONS: Mapping[str, type[Choices]] = {
    "tape": TapeRuns,
    "squares": SquareRuns,
    "imu": HandTurns,
}
"""The calibrations that ask a person, by the verb of the command."""


class ChoiceField(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One choice, as an option or as a field of a form.

    Attributes:
        name: The option's, without its dashes; that of the Struct is ``field``.
        least: The bounds of a number; None: it is a switch.
        more: It is seldom changed.
    """

    name: str
    field: str
    words: str
    default: float | bool
    unit: str = ""
    least: float | None = None
    most: float | None = None
    whole: bool = False
    more: bool = False


def fields_of(choices: type[Choices]) -> tuple[ChoiceField, ...]:
    """The choices of one calibration, the usual ones first, numbers before switches."""
    kind = inspect.type_info(choices)
    assert isinstance(kind, inspect.StructType)
    found = [_described(each) for each in kind.fields]
    return tuple(sorted(found, key=lambda each: (each.more, each.least is None)))


def _described(each: inspect.Field) -> ChoiceField:
    assert isinstance(each.type, inspect.Metadata)
    kind, extra = each.type.type, each.type.extra or {}
    number = kind if isinstance(kind, inspect.IntType | inspect.FloatType) else None
    return ChoiceField(
        name=each.encode_name,
        field=each.name,
        words=(each.type.extra_json_schema or {})["description"],
        default=each.default,
        unit=extra.get("unit", ""),
        least=None if number is None else number.ge,
        most=None if number is None else number.le,
        whole=isinstance(kind, inspect.IntType),
        more=extra.get("more", False),
    )


def read_choices(verb: object, given: Mapping[str, Any]) -> Choices | None:
    """What a page chose; None if there is no such calibration or choice, or a bound is exceeded."""
    if not isinstance(verb, str) or verb not in CALIBRATIONS:
        return None
    try:
        return msgspec.convert(given, CALIBRATIONS[verb])
    except msgspec.ValidationError:
        return None
