"""The configuration as the parameters of a ROS 2 node: read-only, without secrets."""

from __future__ import annotations

from collections.abc import Iterator

from yahboomd.core.config import Config, schema
from yahboomd.core.config.values import Place
from yahboomd.ros2.messages.rcl_interfaces import ParameterServer, Value

REFUSAL = (
    "It is read-only: yahboomd reads its configuration when it starts. Change config.toml, the "
    "environment or --set, and restart yahboomd."
)

HIDDEN: frozenset[Place] = frozenset({("zenoh", "config")})
"""Keys that are no parameters: the file names keys and passwords."""

ENDPOINTS: frozenset[Place] = frozenset({("zenoh", "listen"), ("zenoh", "connect")})


def parameter_server(config: Config) -> ParameterServer:
    """Answers for a configuration."""
    values = dict(_parameters(config.as_data(), ()))
    return ParameterServer(
        {_name(place): value for place, value in values.items()},
        {_name(at): (_meaning(at), schema.takes(schema.node_at(at))) for at in values},
        REFUSAL,
    )


def _name(place: Place) -> str:
    return ".".join(map(str, place))


def _meaning(place: Place) -> str:
    """The meaning of a key; entries of a table or a list have at least its own meaning."""
    *above, last = place
    node = schema.node_at(tuple(above)).get("properties", {}).get(last, {})
    return str(node["description"]) if "description" in node else _meaning(tuple(above))


def _parameters(value: object, place: Place) -> Iterator[tuple[Place, Value]]:
    """Tables and lists of tables become a parameter for each of their values."""
    if place in HIDDEN:
        return
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _parameters(item, (*place, key))
    elif isinstance(value, list) and any(isinstance(item, dict | list) for item in value):
        for index, item in enumerate(value):
            yield from _parameters(item, (*place, index))
    elif isinstance(value, list):
        # Behind the # of an endpoint are keys and passwords of its protocol.
        cut = place in ENDPOINTS
        yield place, tuple(item.partition("#")[0] if cut else item for item in value)
    elif isinstance(value, bool | int | float | str):
        yield place, value
