"""The keys that are recorded, and the schema of the messages on each."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, Any

import msgspec

from yahboomd.core.bus import keys
from yahboomd.core.daemon.publisher import PUBLISHED
from yahboomd.core.messages.codecs import encoding_of
from yahboomd.core.messages.native import EstopRequest, VelocityCommand
from yahboomd.ros2 import ros2_topics
from yahboomd.ros2.messages import ros2_names
from yahboomd.ros2.messages.ros2_names import Qos
from yahboomd.tools.record.mcap_files import Channel
from yahboomd.tools.record.ros_definitions import definition
from yahboomd.tools.schemas.message_schema import schema

if TYPE_CHECKING:
    from yahboomd.core.config import Config

RENAMED = {
    ros2_topics.ODOM: "odom_topic",
    ros2_topics.JOINT_STATES: "joint_states_topic",
    ros2_topics.BATTERY_STATE: "battery_state_topic",
    ros2_topics.DIAGNOSTICS: "diagnostics_topic",
}
"""Topics of ROS 2 with a configurable name, and the key of the name below [ros2]."""


class Recorded(msgspec.Struct, frozen=True):
    """A key of the bus and the types of its messages.

    Attributes:
        topic: Its name in ROS 2, without a leading slash.
        message: The native message; None if there is none.
        ros_type: The type of its CDR messages; empty if there is none.
        qos: Its quality of service in ROS 2.
    """

    key: str
    topic: str
    message: type[msgspec.Struct] | None = None
    ros_type: str = ""
    qos: Qos = Qos()

    def channel(self, payload: bytes) -> tuple[Channel, bytes] | None:
        """The channel of a message, and the bytes to record.

        Returns:
            None for other bytes.
        """
        encoding = encoding_of(payload)
        if encoding == "cdr":
            if not self.ros_type:
                return None
            return _ros_channel(self.topic, self.ros_type, self.qos), payload
        if encoding is None or self.message is None:
            return None
        if encoding == "msgpack":
            try:
                payload = msgspec.json.encode(msgspec.msgpack.decode(payload))
            except (msgspec.MsgspecError, ValueError, TypeError):
                return None
        return _json_channel(self.key, self.message), payload


@cache
def _json_channel(key: str, message: type[msgspec.Struct]) -> Channel:
    # Readers of MCAP expect the type at the top level.
    text = json.dumps({"type": "object", **schema(message)})
    return Channel(key, "json", message.__name__, "jsonschema", text)


@cache
def _ros_channel(topic: str, ros_type: str, qos: Qos) -> Channel:
    text = definition(ros_type) or ""
    return Channel(f"/{topic}", "cdr", ros_type, "ros2msg", text, _qos_text(qos))


def recorded(config: Config) -> list[Recorded]:
    """Every key that a daemon with this configuration publishes or subscribes to."""
    found = [Recorded(key, key, message=message) for key, message in PUBLISHED.items()]
    for source in config.command.sources:
        stamped = source in config.ros2.stamped_commands
        ros_type = ros2_names.TWIST_STAMPED if stamped else ros2_names.TWIST
        found.append(Recorded(source, source, message=VelocityCommand, ros_type=ros_type))
    ros_type = ros2_topics.RECEIVED[keys.ESTOP]
    found.append(Recorded(keys.ESTOP, keys.ESTOP, message=EstopRequest, ros_type=ros_type))
    for name, topic in ros2_topics.ROS_TOPICS.items():
        chosen = getattr(config.ros2, RENAMED[name]) if name in RENAMED else name
        key = _ros_key(config, chosen, topic.ros_type)
        if key:
            found.append(Recorded(key, chosen, ros_type=topic.ros_type, qos=topic.qos))
    return found


def _ros_key(config: Config, topic: str, ros_type: str) -> str:
    """The key of a topic's samples: a plain key for the bridge, otherwise rmw_zenoh's."""
    if config.ros2.bridge:
        return topic
    if not config.ros2.rmw_zenoh:
        return ""
    node = ros2_names.Node(domain_id=config.ros2.domain_id, zid="")
    name = keys.full_key(config.zenoh.namespace, topic)
    return "/" + ros2_names.native_key(
        node, topic=name, ros_type=ros_type, distro=config.ros2.distro
    )


def facts_of(config: Mapping[str, Any]) -> dict[str, str]:
    """The sections of a configuration that turn counts into poses, for a recording."""
    kept = ("board", "chassis", "limits", "odometry", "serial")
    return {name: json.dumps(config[name]) for name in kept if name in config}


def _qos_text(qos: Qos) -> str:
    """A quality of service in rosbag2's format: YAML, with rmw's numbers."""
    unlimited = "{sec: 9223372036, nsec: 854775807}"
    lines = [
        "history: 1",
        f"depth: {qos.depth}",
        f"reliability: {1 if qos.reliable else 2}",
        f"durability: {1 if qos.latched else 2}",
        f"deadline: {unlimited}",
        f"lifespan: {unlimited}",
        "liveliness: 1",
        f"liveliness_lease_duration: {unlimited}",
        "avoid_ros_namespace_conventions: false",
    ]
    return "- " + "\n  ".join(lines)
