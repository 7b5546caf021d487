"""The JSON Schema of a message, in forms that type generators understand."""

from __future__ import annotations

from typing import Any

import msgspec

DIALECT = "https://json-schema.org/draft/2020-12/schema"

EXACT_IN_A_DOUBLE = 2**53
"""Type generators read a schema's numbers as doubles, which would change a larger bound."""


def _none_of(*names: str) -> dict[str, Any]:
    return {"properties": dict.fromkeys(names, False)}


# A rule that a Struct cannot express: a command without any velocity is refused. Type generators
# ignore `not`; from `anyOf` they would make a type for each branch.
_EXTRA: dict[str, dict[str, Any]] = {
    "VelocityCommand": {"not": _none_of("vx", "vy", "wz")},
    "RosVelocityCommand": {
        "not": {"properties": {"linear": _none_of("x", "y"), "angular": _none_of("z")}}
    },
}


def schema(message: type[msgspec.Struct]) -> dict[str, Any]:
    """The JSON Schema of a message, with the message's own definition at the top level."""
    name = message.__name__
    generated = msgspec.json.schema(message)
    definitions: dict[str, Any] = generated["$defs"]
    own: dict[str, Any] = definitions.pop(name)
    result = {"$schema": DIALECT, **own, **_EXTRA.get(name, {})}
    # Python 3.13 strips a docstring's indentation and earlier versions keep it, so strip it here.
    result["description"] = _unindented(own["description"])
    if definitions:
        for one in definitions.values():
            one["description"] = _unindented(one["description"])
        result["$defs"] = definitions
    return {key: _for_generators(value) for key, value in result.items()}


def _for_generators(node: object) -> Any:  # noqa: ANN401 - a schema is any JSON
    """The same schema in forms that every type generator supports.

    A list of fixed length becomes a plain list, because of a tuple they make ``never[]`` or code
    that does not compile. A group of counters becomes an open object. A format marks 64 bits.
    """
    if isinstance(node, list):
        return [_for_generators(item) for item in node]
    if not isinstance(node, dict):
        return node
    form: dict[str, Any] = {key: _for_generators(value) for key, value in node.items()}
    if "prefixItems" in form:
        form["items"] = form.pop("prefixItems")[0]
    if form.get("type") == "integer":
        form["format"] = "int64"
        if form.get("maximum", 0) > EXACT_IN_A_DOUBLE:
            del form["maximum"]
    if form.get("required") == []:
        del form["required"]
    if isinstance(form.get("additionalProperties"), dict):
        form["additionalProperties"] = True
    return form


def _unindented(text: str) -> str:
    return "\n".join(line.strip() for line in text.splitlines())
