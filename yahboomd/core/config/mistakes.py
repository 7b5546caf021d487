"""pydantic's errors in the words of a person who writes TOML, with a suggestion."""

from __future__ import annotations

import difflib
from typing import TYPE_CHECKING

from yahboomd.core.config import schema
from yahboomd.core.config.layers import toml_value
from yahboomd.core.config.schema import ANY
from yahboomd.core.config.values import Place, dotted, inline

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

_OTHER_NAMES = {
    "wheel_diameter": ("wheel_radius_m", ", half of the diameter"),
    "track_width": ("wheel_separation_m", ""),
}
"""Keys by the names that others give them."""

_NO_QUOTES = " (a number takes no quotes)"
_HINTS = {
    "string_type": " (text needs quotes)",
    "tuple_type": " (a list stands in [ ])",
    "int_type": _NO_QUOTES,
    "float_type": _NO_QUOTES,
}


def place_of(error: ErrorDetails) -> Place:
    """The place of an error of pydantic's; an error in a name itself is at that name."""
    return tuple(part for part in error["loc"] if part != "[key]")


def words_for(error: ErrorDetails) -> str:
    place, value = place_of(error), error["input"]
    # This may go into a log, and such a value may be a secret.
    got = "" if place[0] in {"zenoh", "web"} else f", got {shown(value)}"
    if error["type"] == "extra_forbidden":
        return _unknown(place)
    if error["type"] == "text":
        return error["msg"] + got
    takes = schema.takes(schema.node_at(place))
    if error["type"] == "missing":
        return f"missing; expected {takes}"
    hint = _HINTS.get(error["type"], "")
    if error["type"] == "literal_error" and isinstance(value, str):
        hint = _nearest(place, value.lower()[:60], schema.node_at(place)["enum"])
    if hint == _NO_QUOTES and (not isinstance(value, str) or toml_value(value) == value):
        hint = ""
    return f"expected {takes}{got}{hint}"


def shown(value: object) -> str:
    try:
        text = inline(value)
    except (ValueError, RecursionError):
        return "a value too long to show"
    return text if len(text) <= 60 else f"{text[:57]}..."


def _nearest(place: Place, value: str, choices: list[str]) -> str:
    close = difflib.get_close_matches(value, choices, n=1)
    if not close and place == ("ros2", "distro"):
        # They are in alphabetical order, and a newer one is most like the newest.
        close = [choices[0], *(name for name in choices[1:-1] if name < value)][-1:]
    return f'; the nearest is "{close[0]}"' if close else ""


def _unknown(place: Place) -> str:
    """Report an unknown key, and suggest one: the same elsewhere, or a similar one."""
    *table, name = place
    words = f"unknown {'key' if table else 'section'}"
    known = list(schema.node_at(tuple(table))["properties"])
    homes = [home[:-1] for home in schema.places() if home[-1] == name]
    inside = [home for home in homes if ANY in home and home[:1] == place[:1]]
    if inside:
        entries = dotted(inside[0][: inside[0].index(ANY)])
        keys = ", ".join(schema.node_at(inside[0])["properties"])
        return f'{words}; "{name}" belongs to each entry of {entries}, {{ {keys} }}'
    others = {other: own for other, own in _OTHER_NAMES.items() if own[0] in known}
    if close := difflib.get_close_matches(str(name).lower(), [*known, *others], n=1):
        own, how = others.get(close[0], (close[0], ""))
        return f'{words}; did you mean "{own}"{how}?'
    if sections := [f"[{home[0]}]" for home in homes if len(home) == 1]:
        return f'{words}; "{name}" belongs to {" or ".join(sections)}'
    return f"{words}; known here: {', '.join(known)}"
