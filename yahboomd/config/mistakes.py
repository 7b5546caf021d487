"""What is wrong with a value, in words that say what was expected."""

from __future__ import annotations

import difflib
import typing
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from pydantic import BaseModel
from pydantic_core import ErrorDetails

from yahboomd.config.layers import Origin, plain
from yahboomd.config.models import Config
from yahboomd.config.values import BARE_KEY, Choice, Place, dotted, expected, toml_string, unwrap
from yahboomd.config.writing import entry_model


@dataclass(frozen=True, order=True)
class Mistake:
    """One thing that a person has to change; sorts in the order in which they were written."""

    origin: Origin
    place: str
    words: str

    def __str__(self) -> str:
        return plain(": ".join(filter(None, (self.origin.words, self.place, self.words))))


class Slot(NamedTuple):
    """What the models say about a place: its type and constraints, and the names beside it."""

    annotation: Any
    metadata: list[Any]
    siblings: tuple[str, ...]


def slot(place: Place) -> Slot | None:
    """Look up a place in the models; None where they know no such key."""
    found = Slot(Config, [], ())
    for part in place:
        origin, arguments = typing.get_origin(found.annotation), typing.get_args(found.annotation)
        if isinstance(found.annotation, type) and issubclass(found.annotation, BaseModel):
            fields = found.annotation.model_fields
            info = fields.get(str(part))
            if info is None:
                return None
            found = Slot(*unwrap(info.annotation, info.metadata), tuple(fields))
        elif origin is dict and isinstance(part, str):
            found = Slot(*unwrap(arguments[1]), ())
        elif origin is tuple and isinstance(part, int):
            found = Slot(*unwrap(arguments[0]), ())
        else:
            return None
    return found


def takes_texts(place: Place) -> bool:
    """Whether a list of texts stands at a place."""
    at = slot(place)
    if at is None or typing.get_origin(at.annotation) is not tuple:
        return False
    return unwrap(typing.get_args(at.annotation)[0])[0] is str


def place_of(error: ErrorDetails) -> Place:
    """Where an error of pydantic's is; an error in a name itself is at that name."""
    return tuple(part for part in error["loc"] if part != "[key]")


def words_for(error: ErrorDetails) -> str:
    """What pydantic found, in our words."""
    place = place_of(error)
    if error["type"] == "extra_forbidden":
        return _unknown(place)
    if error["loc"][-1:] == ("[key]",):
        return f"expected {_key_words(place)} as the name"
    at = slot(place)
    wanted = expected(at.annotation, at.metadata) if at else "something else"
    if error["type"] == "missing":
        return f"missing; expected {wanted}"
    if error["type"] in {"too_short", "too_long"}:
        context = error.get("ctx", {})
        bound = context.get("min_length", context.get("max_length"))
        most = "least" if error["type"] == "too_short" else "most"
        return f"expected at {most} {bound} entries, got {context.get('actual_length')}"
    return f"expected {wanted}, got {shown(error['input'])}{_hint(at, error['input'])}"


def shown(value: object, limit: int = 60) -> str:
    """A value as TOML writes it, cut where it is long."""
    match value:
        case bool():
            text = "true" if value else "false"
        case str():
            text = toml_string(value)
        case Mapping():
            inner = ", ".join(f"{_bare(str(key))} = {shown(item)}" for key, item in value.items())
            text = f"{{ {inner} }}" if inner else "{}"
        case list() | tuple():
            text = f"[{', '.join(shown(item) for item in value)}]"
        case int() if value.bit_length() > 256:
            text = f"a number of {value.bit_length()} bits"
        case _:
            text = str(value)
    return text if len(text) <= limit else f"{text[: limit - 3]}..."


def suggestion(name: str, known: Iterable[str]) -> str:
    """`` (did you mean ...?)`` for a name that resembles a known one, else which there are."""
    names = list(known)
    close = difflib.get_close_matches(name.lower(), names, n=1, cutoff=0.6)
    if close:
        return f'; did you mean "{close[0]}"?'
    return f"; known here: {', '.join(names)}" if names else ""


def section_of(key: str) -> str | None:
    """The section that has ``key``, for one written at the wrong place; None unless just one."""
    homes = [
        name
        for name, info in Config.model_fields.items()
        if isinstance(info.annotation, type)
        and issubclass(info.annotation, BaseModel)
        and key in info.annotation.model_fields
    ]
    return homes[0] if len(homes) == 1 else None


def _unknown(place: Place) -> str:
    around = slot(place[:-1])
    name = str(place[-1])
    kind = "section" if len(place) == 1 else "key"
    if around is None or not hasattr(around.annotation, "model_fields"):
        return f"unknown {kind}"
    known = tuple(around.annotation.model_fields)
    if entries := _entries_with(name, around.annotation, place[:-1]):
        return f'unknown {kind}; "{name}" belongs to each entry of {entries}'
    close = difflib.get_close_matches(name.lower(), known, n=1, cutoff=0.6)
    home = section_of(name)
    if not close and home is not None:
        return f'unknown {kind}; "{name}" belongs to [{home}]'
    return f"unknown {kind}{suggestion(name, known)}"


def _entries_with(name: str, section: type[BaseModel], place: Place) -> str:
    """The table of a section whose entries have a key of that name; empty where none has."""
    for key, info in section.model_fields.items():
        holds_entries = typing.get_origin(unwrap(info.annotation)[0]) in {dict, tuple}
        model = entry_model(info) if holds_entries else None
        if model is not None and name in model.model_fields:
            needed = [each for each, field in model.model_fields.items() if field.is_required()]
            words = ", ".join(f"{each} = \u2026" for each in dict.fromkeys((*needed, name)))
            return f"{dotted((*place, key))}: {{ {words} }}"
    return ""


def _key_words(place: Place) -> str:
    around = slot(place[:-1])
    if around is None:
        return "another word"
    return expected(*unwrap(typing.get_args(around.annotation)[0]))


def _hint(at: Slot | None, value: object) -> str:
    if at is None:
        return ""
    for mark in at.metadata:
        if isinstance(mark, Choice) and mark.reason(value):
            return f" ({mark.reason(value)})"
    if at.annotation is str and isinstance(value, int | float) and not isinstance(value, bool):
        return " (text needs quotes)"
    if at.annotation in {int, float} and isinstance(value, str):
        try:
            float(value)
        except ValueError:
            return ""
        return " (a number takes no quotes)"
    if typing.get_origin(at.annotation) is tuple and isinstance(value, str | Mapping):
        return " (a list stands in [ ])"
    return ""


def _bare(key: str) -> str:
    return key if BARE_KEY.fullmatch(key) else toml_string(key)
