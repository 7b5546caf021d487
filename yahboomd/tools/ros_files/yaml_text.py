"""Writes trees of parameters as YAML that ROS 2 reads: tables, and lists in one line."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping


def as_yaml(tree: Mapping[str, object], indent: str = "") -> str:
    """The tree as YAML. A float keeps its point, because ROS 2 tells floats from integers."""
    return "".join(_lines(tree, indent))


def _lines(tree: Mapping[str, object], indent: str) -> Iterator[str]:
    for key, value in tree.items():
        if isinstance(value, Mapping):
            yield f"{indent}{key}:\n"
            yield from _lines(value, indent + "  ")
        else:
            yield f"{indent}{key}: {_scalar(value)}\n"


def _scalar(value: object) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_scalar, value))}]"
    if isinstance(value, float):
        # Without an exponent, because YAML reads 1e-06 as text; and without a negative zero.
        text = f"{value + 0.0:.9f}".rstrip("0")
        return f"{text}0" if text.endswith(".") else text
    return json.dumps(value)
