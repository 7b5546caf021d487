"""Nodes that ROS 2 leaves without a word: their type is another, or the bridge forgot their route.

Natively their tokens show them. Behind the bridge its admin space does: it lists all DDS writers,
also those whose messages it cannot deliver.
"""

from __future__ import annotations

import logging

import msgspec

from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.presence import TokenChange
from yahboomd.core.clock import nanoseconds
from yahboomd.core.daemon.planes import Guard
from yahboomd.core.daemon.publisher import Pace
from yahboomd.ros2.messages import ros2_names
from yahboomd.ros2.ros2_routes import RouteWatch
from yahboomd.ros2.survey import Survey, decoded

log = logging.getLogger(__name__)

ASK_EVERY_S = 5.0
"""The period of the questions to the bridges."""


class _Writer(msgspec.Struct):
    """The part of a DDS writer in a bridge's admin space that matters here."""

    type_name: str


class TypeWatch:
    """Knows the types that nodes publish on the topics of commands."""

    def __init__(self, bus: Bus, guarded: Guard) -> None:
        self._bus = bus
        self._guarded = guarded
        self._pace = Pace(nanoseconds(ASK_EVERY_S))
        self._surveys: list[Survey] = []
        self._behind_bridges: dict[str, dict[str, frozenset[str]]] = {}
        self._tokens: dict[str, dict[str, str]] = {}
        self._expected: dict[str, str] = {}
        self._logged = set[str]()
        self.routes = RouteWatch(bus, guarded)
        self._route_warning = ""

    def watch_bridges(self, source: str, ros_type: str) -> None:
        """Ask bridges for the writers of a topic.

        A bridge with a namespace of its own leaves ours out of the names that ROS sees.

        Args:
            ros_type: The expected one; "" for a topic that is yahboomd's alone.
        """
        self._expected[source] = ros_type
        found = self._behind_bridges.setdefault(source, {})
        named = (self._bus.key(source), source) if ros_type else (self._bus.key(source),)
        for topic in dict.fromkeys(named):

            def answered(answers: list[bytes], topic: str = topic) -> None:
                types = (each.type_name for each in decoded(answers, _Writer))
                found[topic] = frozenset(map(ros2_names.ros_type_of, types))

            handler = self._guarded("The types behind the bridge", answered)
            self._surveys.append(Survey(self._bus, f"/{ros2_names.bridge_writers(topic)}", handler))

    def watch_nodes(self, source: str, ros_type: str, domain_id: int) -> None:
        self._expected[source] = ros_type
        found = self._tokens.setdefault(source, {})

        def changed(changes: list[TokenChange]) -> None:
            for change in changes:
                if change.present and f"/{self._bus.zid}/" not in change.key:
                    found[change.key] = ros2_names.type_of_token(change.key)
                else:
                    found.pop(change.key, None)

        pattern = ros2_names.publisher_tokens(domain_id, self._bus.key(source))
        self._bus.watch_tokens(f"/{pattern}", self._guarded("The types of nodes", changed))

    def warnings(self, now_ns: int) -> dict[str, str]:
        """The faults by source, and those of routes. Call it repeatedly: it asks the bridges."""
        if self._pace.due(now_ns) and self._bus.neighbours:
            for survey in self._surveys:
                survey.ask()
            self._route_warning = self.routes.ask()
        found = dict[str, str]()
        if self._route_warning:
            found["bridge"] = self._logged_once(self._route_warning)
        for source, expected in self._expected.items():
            behind = frozenset[str]().union(*self._behind_bridges.get(source, {}).values())
            # Both kinds of commands are heard natively; one is announced.
            beside = set(self._tokens.get(source, {}).values()) - {
                ros2_names.TWIST,
                ros2_names.TWIST_STAMPED,
            }
            if others := sorted(behind - {expected} | beside):
                found[source] = self._words(source, expected, others)
        return found

    def _words(self, source: str, expected: str, others: list[str]) -> str:
        key = self._bus.key(source)
        return self._logged_once(
            f"Another program publishes {key}, which is yahboomd's: a second robot, which one "
            "command drives as well, or a node such as joint_state_publisher. Give each robot a "
            "namespace; end that node, or switch the topic off in [ros2]."
            if not expected
            else f"A node publishes {' and '.join(others)} on {key}, where yahboomd "
            f"expects {expected}: its commands may not arrive. {_remedy(source, expected, others)}"
        )

    def _logged_once(self, words: str) -> str:
        if words not in self._logged:
            self._logged.add(words)
            log.warning("%s", words)
        return words


def _remedy(source: str, expected: str, others: list[str]) -> str:
    if expected == ros2_names.TWIST and ros2_names.TWIST_STAMPED in others:
        return (
            f'Add "{source}" to ros2.stamped_commands and restart yahboomd, or have it send Twist.'
        )
    if expected == ros2_names.TWIST_STAMPED and ros2_names.TWIST in others:
        return (
            f'Take "{source}" out of ros2.stamped_commands and restart yahboomd, or have it send '
            "TwistStamped."
        )
    return "Have it send that type, or publish elsewhere."
