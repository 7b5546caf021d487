"""Nodes that read a topic which the bridge does not send them.

The bridge knows nodes by name: as the lease of a killed one ends, it retires the route that the
next one of that name needs (zenoh-plugin-ros2dds #702, #705). Its admin space shows retired routes
and the readers.
"""

from __future__ import annotations

from functools import partial

import msgspec

from yahboomd.core.bus.bus import Bus
from yahboomd.core.daemon.planes import Guard
from yahboomd.ros2.messages import ros2_names
from yahboomd.ros2.survey import Survey, decoded


class _Route(msgspec.Struct):
    """The part of a route in a bridge's admin space that matters here."""

    ros2_name: str
    is_active: bool


class RouteWatch:
    """Knows which of yahboomd's topics have readers behind a bridge, and no route to them."""

    def __init__(self, bus: Bus, guarded: Guard) -> None:
        self._bus = bus
        self._guarded = guarded
        handler = guarded("The routes of the bridge", self._set_retired)
        self._routes = Survey(bus, f"/{ros2_names.BRIDGE_ROUTES}", handler)
        self._surveys: dict[str, Survey] = {}
        self._readers: dict[str, list[bytes]] = {}
        self._retired = set[str]()
        self._suspects = set[str]()

    def watch(self, topic: str) -> None:
        """Watch a topic that yahboomd publishes.

        A bridge with a namespace of its own leaves ours out of the names that ROS sees.
        """
        for name in (self._bus.key(topic), topic):
            answered = self._guarded("Its readers", partial(self._readers.__setitem__, name))
            self._surveys[name] = Survey(self._bus, f"/{ros2_names.bridge_readers(name)}", answered)

    def ask(self) -> str:
        """Ask the bridges; the fault by their answers to the last two rounds, or ""."""
        without = {name for name in self._retired if self._readers.get(name)}
        # A new reader shows a moment before its route.
        names = sorted(without & self._suspects)
        self._suspects = without
        self._readers.clear()
        self._routes.ask()
        for name in self._retired:
            self._surveys[name].ask()
        if not names:
            return ""
        return (
            f"The bridge does not send /{', /'.join(names)} to a node that reads it, as after "
            "one was killed and started again under its name. Restart the bridge, or the node "
            "under another name; the resident of the bring-up package prevents it."
        )

    def _set_retired(self, answers: list[bytes]) -> None:
        routes = decoded(answers, _Route)
        active = {route.ros2_name for route in routes if route.is_active}
        silent = {route.ros2_name for route in routes} - active
        self._retired = {name for name in self._surveys if f"/{name}" in silent}
