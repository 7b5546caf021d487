"""Two ways into ROS 2's graphs: what each publishes on, subscribes to, answers and announces.

`BridgeWay` goes through zenoh-bridge-ros2dds: CDR on plain keys, and tokens that announce the
types. Data flows without tokens too; with them the topics show, and can be matched, before any ROS
node uses them.

`NativeWay` is a node among those of rmw_zenoh. Its keys carry domain, type and hash, so all of them
stand outside the namespace, which is part of the topics' names instead. Every sample and every
answer carries an attachment; a malformed one ends the process that receives it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.services import BusQuery, Response
from yahboomd.core.bus.subscriptions import Arrival
from yahboomd.core.daemon.publisher import Outlet
from yahboomd.core.daemon.requests import Answer
from yahboomd.core.messages.codecs import encode_reply, encoding_name
from yahboomd.core.messages.native import ServiceReply
from yahboomd.core.names import is_ros_name
from yahboomd.ros2 import ros2_topics
from yahboomd.ros2.messages import ros2_names
from yahboomd.ros2.messages.rcl_interfaces import ParameterServer
from yahboomd.ros2.messages.ros2_names import EndpointKind, Node, Qos

NO_QOS = Qos()
"""Services have none; their tokens leave it out."""


class BridgeWay:
    """Opens topics on plain keys, and announces them.

    Args:
        distro: Of the nodes behind the bridge: decides whether types have hashes.
    """

    def __init__(self, bus: Bus, distro: str) -> None:
        self._bus = bus
        self._distro = distro

    def publisher(self, topic: str, ros_type: str, qos: Qos) -> Outlet:
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
        self._announce("SS", key, ros_type, NO_QOS)

    def _announce(self, kind: EndpointKind, key: str, ros_type: str, qos: Qos) -> None:
        if not is_ros_name(self._bus.key(key)):
            # No ROS node could call it by this name; its data still flows.
            return
        token = ros2_names.bridge_token(
            kind,
            zid=self._bus.zid,
            key=self._bus.key(key),
            ros_type=ros_type,
            qos=qos,
            distro=self._distro,
        )
        self._bus.token(f"/{token}")


SERVICE_QOS = Qos(depth=10)

PARAMETERS_MAX_BYTES = 8192
"""The limit of a request for parameters: a client may ask for all of them by their names, which are
2 kB. An answer to that takes 10 ms, half a control period."""

_NO_CLIENT = ros2_names.Attachment(sequence=1, stamp_ns=0, gid=bytes(ros2_names.GID_BYTES))
"""Used if a request has no attachment: its sender is no client of rmw_zenoh's."""


class TakesAttachments(Protocol):
    """A publisher of the bus."""

    @property
    def has_subscribers(self) -> bool:
        """Whether any client would receive the samples."""

    def put(self, payload: bytes, attachment: bytes | None = None) -> bool:
        """Send one."""


class AttachedOutlet:
    """Numbers and stamps every sample, as rmw_zenoh does.

    Args:
        gid: Distinguishes this publisher from all others.
    """

    def __init__(self, publisher: TakesAttachments, gid: bytes, wall_ns: Callable[[], int]) -> None:
        self._publisher = publisher
        self._gid = gid
        self._wall_ns = wall_ns
        self._sequence = 0

    @property
    def has_subscribers(self) -> bool:
        return self._publisher.has_subscribers

    def put(self, payload: bytes) -> bool:
        self._sequence += 1
        attached = ros2_names.attachment(self._sequence, self._wall_ns(), self._gid)
        return self._publisher.put(payload, attached)


class NativeWay:
    """A node of an rmw_zenoh graph: it shows as soon as this is made.

    Args:
        domain_id: ``ROS_DOMAIN_ID`` of the graph.
        distro: Of the graph: decides the types' hashes.
    """

    def __init__(
        self, bus: Bus, *, domain_id: int, distro: str, wall_ns: Callable[[], int]
    ) -> None:
        self._bus = bus
        self._distro = distro
        self._wall_ns = wall_ns
        self._node = Node(domain_id=domain_id, zid=bus.zid, namespace=bus.options.namespace)
        self._entities = 0
        bus.token(f"/{ros2_names.node_token(self._node)}")

    def publisher(self, topic: str, ros_type: str, qos: Qos) -> Outlet:
        if topic == ros2_topics.ROSOUT:
            # The nodes of a graph share one log, across namespaces.
            topic = f"/{topic}"
        publisher = self._bus.publisher(
            self._key(topic, ros_type),
            encoding=encoding_name(ros_type, "cdr"),
            cache=qos.depth if qos.latched else 0,
        )
        gid = ros2_names.gid_of(self._announce("MP", topic, ros_type, qos))
        return AttachedOutlet(publisher, gid, self._wall_ns)

    def subscriber(
        self,
        topic: str,
        ros_type: str,
        qos: Qos,
        handler: Callable[[list[Arrival]], None],
        *,
        also: str = "",
    ) -> None:
        """Subscribe to a topic.

        Args:
            topic: Its name below the namespace.
            also: A second type that is accepted without being announced: different types on a topic
                confuse ROS's tools, and a robot that ignores one of them its users.
        """
        self._announce("MS", topic, ros_type, qos)
        for heard in filter(None, (ros_type, also)):
            self._bus.subscribe(self._key(topic, heard), handler)

    def alarm(self, topic: str, ros_type: str, qos: Qos, hear: Callable[[str], None]) -> None:
        """Subscribe to a topic that must not lose a sample.

        Args:
            topic: Its name below the namespace.
            hear: Subscribes on the key given.
        """
        hear(self._key(topic, ros_type))
        self._announce("MS", topic, ros_type, qos)

    def service(self, key: str, ros_type: str, offer: Callable[[str, Answer], None]) -> None:
        """Offer a service.

        Args:
            key: Its name below the namespace.
            offer: Serves it on the key given, answering as given.
        """
        offer(self._key(key, ros_type), self._answer)
        self._announce("SS", key, ros_type, SERVICE_QOS)

    def parameters(self, server: ParameterServer) -> None:
        for name, (ros_type, respond) in server.services.items():
            service = f"{self._node.name}/{name}"
            self._serve(self._key(service, ros_type), respond)
            self._announce("SS", service, ros_type, SERVICE_QOS)

    def _serve(self, key: str, respond: Callable[[bytes], bytes]) -> None:
        self._bus.serve(
            key,
            lambda request: self._respond(request, respond(request.payload)),
            fallback=lambda _, request: self._respond(request, respond(b"")),
            max_bytes=PARAMETERS_MAX_BYTES,
        )

    def _answer(self, request: BusQuery, reply: ServiceReply) -> Response:
        return self._respond(request, encode_reply(reply, "cdr"))

    def _respond(self, request: BusQuery, payload: bytes) -> Response:
        asked = ros2_names.parse_attachment(request.attachment or b"") or _NO_CLIENT
        return Response(
            payload=payload,
            attachment=ros2_names.attachment(asked.sequence, self._wall_ns(), asked.gid),
        )

    def _key(self, topic: str, ros_type: str) -> str:
        key = ros2_names.native_key(
            self._node, topic=self._bus.key(topic), ros_type=ros_type, distro=self._distro
        )
        return f"/{key}"

    def _announce(self, kind: EndpointKind, topic: str, ros_type: str, qos: Qos) -> str:
        self._entities += 1
        token = ros2_names.endpoint_token(
            kind,
            self._node,
            entity=self._entities,
            topic=self._bus.key(topic),
            ros_type=ros_type,
            qos=qos,
            distro=self._distro,
        )
        self._bus.token(f"/{token}")
        return token
