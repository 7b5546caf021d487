"""The JSON Schema of the configuration, and its words about each key."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, TypeAlias

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue

from yahboomd.core.config.models import Config
from yahboomd.core.config.values import Place, inline, number

Node: TypeAlias = Mapping[str, Any]
"""A part of the schema."""

ANY = "*"
"""In a place: any name in a table of names, any entry of a list."""

_TYPES = {
    "boolean": "true or false",
    "integer": "a whole number",
    "number": "a number",
    "string": "text",
}
_BOUNDS = {
    "minimum": "at least",
    "exclusiveMinimum": "greater than",
    "maximum": "at most",
    "exclusiveMaximum": "less than",
}


class _InOrder(GenerateJsonSchema):
    """Leaves the keys of defaults in the order of the sections."""

    def sort(self, value: JsonSchemaValue, parent_key: str | None = None) -> JsonSchemaValue:  # noqa: ARG002
        return value


@cache
def _whole() -> Node:
    return Config.model_json_schema(schema_generator=_InOrder)


def as_json() -> str:
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "yahboomd"}
    return json.dumps({**_whole(), **head}, indent=2, ensure_ascii=False) + "\n"


def resolved(node: Node) -> Node:
    """The node without its ``$ref``, and without the choice to be absent."""
    for inner in (*node.get("anyOf", ()), *node.get("allOf", ())):
        return resolved(inner)
    return _whole()["$defs"][node["$ref"].rsplit("/", 1)[-1]] if "$ref" in node else node


def node_at(place: Place) -> Node:
    node = _whole()
    for part in place:
        inside = _entries(node)
        node = resolved(node["properties"][part] if inside is None else inside)
    return node


@cache
def places() -> tuple[Place, ...]:
    return tuple(_places(_whole(), ()))


def _places(node: Node, at: Place) -> Iterator[Place]:
    node = resolved(node)
    for key, inner in node.get("properties", {}).items():
        yield (*at, key)
        yield from _places(inner, (*at, key))
    if inside := _entries(node):
        yield from _places(inside, (*at, ANY))


def entry_table(node: Node) -> Node | None:
    """The table that a key holds, by name or in a list; None if it holds none."""
    node = resolved(node)
    inside = _entries(node)
    return entry_table(inside) if inside else node if "properties" in node else None


def takes(node: Node) -> str:
    node = resolved(node)
    if "enum" in node:
        *names, last = map(inline, node["enum"])
        return f"{', '.join(names)} or {last}"
    if "properties" in node:
        return f"a table {{ {', '.join(node['properties'])} }}"
    if comment := node.get("$comment"):
        return str(comment)
    inside = _entries(node)
    if inside is None:
        return _TYPES[node["type"]] + _bounds(node)
    if node["type"] == "object":
        return f"a table of names, each {takes(inside)}"
    size = f" of {node['minItems']} to {node['maxItems']}" if "maxItems" in node else ""
    return f"a list{size}, each entry {takes(inside)}"


def constraint(node: Node) -> str:
    """The values that a key takes, as a sentence, if that is more than its type."""
    words = takes(node)
    is_plain = resolved(node).get("type") == "object" or words in _TYPES.values()
    return "" if is_plain else f" Takes {words}."


def _entries(node: Node) -> Node | None:
    inside = node.get("items", node.get("additionalProperties"))
    return inside if isinstance(inside, Mapping) else None


def _bounds(node: Node) -> str:
    if "minimum" in node and "maximum" in node:
        return f" from {number(node['minimum'])} to {number(node['maximum'])}"
    found = [f"{word} {number(node[key])}" for key, word in _BOUNDS.items() if key in node]
    return f" {' and '.join(found)}" if found else ""
