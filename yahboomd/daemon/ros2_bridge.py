"""The way into ROS 2 through zenoh-bridge-ros2dds: plain keys, and tokens that announce them.

The bridge takes what is on a key for CDR of the type that was announced. Data flow without tokens
too; with them the topics show, and can be matched, before any ROS node uses them.
"""

from __future__ import annotations

from yahboomd.bus.session import Bus
from yahboomd.config.values import is_topic
from yahboomd.daemon.publisher import Outlet
from yahboomd.messages import ros2
from yahboomd.messages.codecs import encoding_name
from yahboomd.messages.ros2 import EndpointKind, Qos

NO_QOS = Qos()
"""Services have none; their tokens leave it out."""


class BridgeWay:
    """Opens topics on plain keys, and announces them.

    Args:
        bus: An open session.
        distro: Of the nodes behind the bridge: decides whether types have hashes.
    """

    def __init__(self, bus: Bus, distro: str) -> None:
        self._bus = bus
        self._distro = distro

    def publisher(self, topic: str, ros_type: str, qos: Qos) -> Outlet:
        """Open a topic that we publish."""
        outlet = self._bus.publisher(
            topic,
            encoding=encoding_name(ros_type, "cdr"),
            cache=qos.depth if qos.latched else 0,
        )
        self._announce("MP", topic, ros_type, qos)
        return outlet

    def subscriber(self, topic: str, ros_type: str, qos: Qos) -> None:
        """Announce a topic that is subscribed to already: the plain key takes any encoding."""
        self._announce("MS", topic, ros_type, qos)

    def service(self, key: str, ros_type: str) -> None:
        """Announce a service that is offered already."""
        self._announce("SS", key, ros_type, NO_QOS)

    def _announce(self, kind: EndpointKind, key: str, ros_type: str, qos: Qos) -> None:
        if not is_topic(self._bus.key(key)):
            # No ROS node could call it by this name; the data flow all the same.
            return
        token = ros2.bridge_token(
            kind,
            zid=self._bus.zid,
            key=self._bus.key(key),
            ros_type=ros_type,
            qos=qos,
            distro=self._distro,
        )
        self._bus.token(f"/{token}")
