"""A configuration as commented TOML, which reads back as the same configuration."""

from __future__ import annotations

import textwrap
import typing
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from yahboomd.config.layers import Origin
from yahboomd.config.models import Config
from yahboomd.config.values import Place, dotted, expected, toml_string, unwrap

WIDTH = 96
"""Columns of a comment."""


def as_toml(
    config: Config, *, origins: Mapping[Place, Origin] | None = None, header: str = ""
) -> str:
    """Write every key with its meaning; optional keys that are absent stand in a comment.

    Args:
        config: What to write.
        origins: Where keys were written: each value is followed by its own.
        header: Comment at the top, without the ``#``.
    """
    lines = [*_comment(header), *([""] if header else [])]
    for name in Config.model_fields:
        section = getattr(config, name)
        lines += _comment(doc(type(section)))
        lines += [f"[{name}]", *_section(section, (name,), origins), ""]
    return "\n".join(lines).rstrip() + "\n"


def doc(model: type[BaseModel]) -> str:
    """What a table is about: its docstring."""
    return textwrap.dedent("    " + (model.__doc__ or "")).strip()


def constraint(info: FieldInfo) -> str:
    """What a key takes where that is more than its type; empty for a plain one."""
    annotation, marks = unwrap(info.annotation, info.metadata)
    words = expected(annotation, marks)
    plain = {expected(kind) for kind in (bool, int, float, str)}
    is_table = typing.get_origin(annotation) is dict or _is_model(annotation)
    return "" if is_table or words in plain else words


def entry_model(info: FieldInfo) -> type[BaseModel] | None:
    """The model of the tables that a key holds, by name or in a list; None where it holds none."""
    annotation, _ = unwrap(info.annotation, info.metadata)
    while typing.get_origin(annotation) in {dict, tuple}:
        arguments = typing.get_args(annotation)
        inner = arguments[1] if typing.get_origin(annotation) is dict else arguments[0]
        annotation, _ = unwrap(inner)
    return annotation if _is_model(annotation) else None


def inline(value: object) -> str:
    """A value on one line, as TOML writes it."""
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            return toml_string(value)
        case BaseModel():
            given = {key: item for key, item in value if item is not None}
            return inline(given)
        case Mapping():
            pairs = [f"{dotted((key,))} = {inline(item)}" for key, item in value.items()]
            return f"{{ {', '.join(pairs)} }}" if pairs else "{}"
        case list() | tuple():
            return f"[{', '.join(inline(item) for item in value)}]"
        case _:
            return repr(value)


def _section(
    section: BaseModel, place: Place, origins: Mapping[Place, Origin] | None
) -> Iterator[str]:
    tables: list[str] = []
    explained: set[type[BaseModel]] = set()
    for key, info in type(section).model_fields.items():
        value = getattr(section, key)
        words = constraint(info)
        about = _comment(f"{info.description}{f' Takes {words}.' if words else ''}")
        entry = entry_model(info)
        if entry is not None and entry not in explained:
            explained.add(entry)
            about += [line for item in _entry_docs(entry) for line in item]
        at = (*place, key)
        if entry is not None and isinstance(value, dict) and value:
            tables += ["", *about, *_tables(value, at, origins)]
        elif value is None:
            yield from ("", *about, f"# {key} = {inline((info.examples or [0])[0])}")
        else:
            yield from ("", *about, f"{key} = {inline(value)}{_origin(at, origins)}")
    yield from tables


def _tables(
    value: dict[str, Any], at: Place, origins: Mapping[Place, Origin] | None
) -> Iterator[str]:
    # Tables by name get a header each; lists by name share one.
    if not all(isinstance(item, BaseModel) for item in value.values()):
        yield f"[{dotted(at)}]"
        for name, item in value.items():
            yield f"{dotted((name,))} = {inline(item)}{_origin((*at, name), origins)}"
        return
    for index, (name, item) in enumerate(value.items()):
        yield from ([""] if index else [])
        yield f"[{dotted((*at, name))}]"
        for key, entry in item:
            if entry is not None:
                yield f"{key} = {inline(entry)}{_origin((*at, name, key), origins)}"


def _entry_docs(model: type[BaseModel]) -> Iterator[list[str]]:
    for key, info in model.model_fields.items():
        words = constraint(info)
        text = f"{key}: {info.description}{f' Takes {words}.' if words else ''}"
        yield _wrapped(text, "#   ", "#     ")


def _origin(place: Place, origins: Mapping[Place, Origin] | None) -> str:
    if origins is None:
        return ""
    inside = {at.words for key, at in origins.items() if key[: len(place)] == place}
    around = [origins[place[:end]] for end in range(len(place), 1, -1) if place[:end] in origins]
    # A table written over several layers names each of them.
    words = ", ".join(sorted(inside)) or (around[0].words if around else "default")
    return f"  # {words}"


def _comment(text: str) -> list[str]:
    lines: list[str] = []
    for number, paragraph in enumerate(text.split("\n\n")):
        lines += ["#"] if number else []
        lines += _wrapped(paragraph, "# ", "# ")
    return lines


def _wrapped(text: str, first: str, rest: str) -> list[str]:
    return textwrap.wrap(
        " ".join(text.split()),
        WIDTH,
        initial_indent=first,
        subsequent_indent=rest,
        break_long_words=False,
        break_on_hyphens=False,
    )


def _is_model(annotation: object) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)
