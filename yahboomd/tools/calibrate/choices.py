"""The choices of each calibration: the options of the command, and the fields of the page's form.

The bounds are the page's. A person at the terminal may choose any positive number.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Any, TypeAlias

import msgspec
from msgspec import Meta


def _seldom(words: str, **bounds: Any) -> Meta:  # noqa: ANN401
    """Of a choice that is seldom changed."""
    return Meta(description=words, extra_json_schema={"more": True}, **bounds)


def _option(name: str) -> str:
    return re.sub("_(m|m_s|rad_s)$", "", name).replace("_", "-")


class DrivenRuns(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, rename=_option
):
    """What both calibrations by a tape measure have in common."""

    speed_m_s: Annotated[float, _seldom("speed, m/s", ge=0.02, le=1.0)] = 0.2
    turn_speed_rad_s: Annotated[float, _seldom("speed of turns, rad/s", ge=0.1, le=3.0)] = 0.8
    dry_run: Annotated[bool, _seldom("show the result, write nothing")] = False


class TapeRuns(DrivenRuns, frozen=True, kw_only=True):
    """A straight, turns in place, and ways to the side of a mecanum base."""

    straight_m: Annotated[float, Meta(ge=0.2, le=20.0, description="straight run, m")] = 2.0
    turns: Annotated[int, Meta(ge=1, le=50, description="turns in place each way")] = 5
    sideways_m: Annotated[float, _seldom("to each side (mecanum wheels), m", ge=0.2, le=5.0)] = 1.0


class SquareRuns(DrivenRuns, frozen=True, kw_only=True):
    """Squares in both directions, and a straight."""

    side_m: Annotated[float, Meta(ge=0.2, le=10.0, description="side of a square, m")] = 2.0
    count: Annotated[int, Meta(ge=1, le=50, description="squares each way")] = 5
    straight_m: Annotated[float, Meta(ge=0.2, le=20.0, description="straight run, m")] = 5.0


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


def fields_of(choices: type[Choices]) -> dict[str, dict[str, Any]]:
    """The choices of one calibration as JSON Schema, by the names of their options.

    The usual ones come first, and numbers before switches.
    """
    (described,) = msgspec.json.schema(choices)["$defs"].values()
    found = described["properties"].items()
    return dict(sorted(found, key=lambda it: ("more" in it[1], it[1]["type"] == "boolean")))


def read_choices(verb: object, given: Mapping[str, Any]) -> Choices | None:
    """The choices that a page sent; None unless all exist and are within their bounds."""
    if not isinstance(verb, str) or verb not in CALIBRATIONS:
        return None
    try:
        return msgspec.convert(given, CALIBRATIONS[verb])
    except msgspec.ValidationError:
        return None
