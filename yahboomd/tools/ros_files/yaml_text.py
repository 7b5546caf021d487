"""Trees of parameters as YAML, in the part of it that ROS 2 reads: tables, and lists in a line."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping


def as_yaml(tree: Mapping[str, object], indent: str = "") -> str:
    """The tree as lines of YAML; a number with a fraction stays one, which ROS 2 tells apart."""
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
        # YAML takes 1e-06 for a text. And no minus in front of a zero.
        text = f"{value + 0.0:.9f}".rstrip("0")
        return f"{text}0" if text.endswith(".") else text
    return json.dumps(value)
