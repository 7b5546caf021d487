"""The way into ROS 2 without a bridge: as a node among those of rmw_zenoh.

Keys carry domain, type and hash, so all of them stand outside the namespace, which is part of the
topics' names instead. Every sample and every answer carries an attachment; a malformed one ends
the process that receives it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from yahboomd.bus.services import Request, Response
from yahboomd.bus.session import Bus
from yahboomd.bus.subscriptions import Arrival
from yahboomd.daemon.publisher import Outlet
from yahboomd.daemon.services import Answer
from yahboomd.messages import ros2
from yahboomd.messages.codecs import encode_reply, encoding_name
from yahboomd.messages.native import ServiceReply
from yahboomd.messages.ros2 import EndpointKind, Node, Qos

SERVICE_QOS = Qos(depth=10)

_NOBODY = ros2.Attachment(sequence=1, stamp_ns=0, gid=bytes(ros2.GID_BYTES))
"""Stands in where a request has no attachment: its sender is no client of rmw_zenoh's."""


class TakesAttachments(Protocol):
    """A publisher of the bus."""

    @property
    def has_subscribers(self) -> bool:
        """Whether anybody would get what is put."""
        ...

    def put(self, payload: bytes, attachment: bytes | None = None) -> bool:
        """Send one."""
        ...


class AttachedOutlet:
    """Numbers and stamps every sample, as rmw_zenoh does.

    Args:
        publisher: Sends them.
        gid: Tells this publisher from all others.
        wall_ns: Unix time.
    """

    def __init__(self, publisher: TakesAttachments, gid: bytes, wall_ns: Callable[[], int]) -> None:
        self._publisher = publisher
        self._gid = gid
        self._wall_ns = wall_ns
        self._sequence = 0

    @property
    def has_subscribers(self) -> bool:
        """Whether anybody would get it."""
        return self._publisher.has_subscribers

    def put(self, payload: bytes) -> bool:
        """Send one."""
        self._sequence += 1
        attached = ros2.attachment(self._sequence, self._wall_ns(), self._gid)
        return self._publisher.put(payload, attached)


class NativeWay:
    """A node of an rmw_zenoh graph: it shows as soon as this is made.

    Args:
        bus: An open session.
        domain_id: ``ROS_DOMAIN_ID`` of the graph.
        distro: Of the graph: decides the types' hashes.
        wall_ns: Unix time.
    """

    def __init__(
        self, bus: Bus, *, domain_id: int, distro: str, wall_ns: Callable[[], int]
    ) -> None:
        self._bus = bus
        self._distro = distro
        self._wall_ns = wall_ns
        self._node = Node(domain_id=domain_id, zid=bus.zid, namespace=bus.options.namespace)
        self._entities = 0
        bus.token(f"/{ros2.node_token(self._node)}")

    def publisher(self, topic: str, ros_type: str, qos: Qos) -> Outlet:
        """Open a topic that we publish."""
        publisher = self._bus.publisher(
            self._key(topic, ros_type),
            encoding=encoding_name(ros_type, "cdr"),
            cache=qos.depth if qos.latched else 0,
        )
        gid = ros2.gid_of(self._announce("MP", topic, ros_type, qos))
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
            ros_type: The type that is announced.
            qos: As it is announced.
            handler: Takes what arrives.
            also: A type that is heard besides, without being announced: a topic whose types do
                not agree confuses ROS's tools, but a robot that ignores half of them its users.
        """
        self._announce("MS", topic, ros_type, qos)
        for heard in filter(None, (ros_type, also)):
            self._bus.subscribe(self._key(topic, heard), handler)

    def service(self, key: str, ros_type: str, offer: Callable[[str, Answer], None]) -> None:
        """Offer a service.

        Args:
            key: Its name below the namespace.
            ros_type: Its type.
            offer: Serves it on the key given, answering as given.
        """
        offer(self._key(key, ros_type), self._answer)
        self._announce("SS", key, ros_type, SERVICE_QOS)

    def _answer(self, request: Request, reply: ServiceReply) -> Response:
        asked = ros2.parse_attachment(request.attachment or b"") or _NOBODY
        return Response(
            payload=encode_reply(reply, "cdr"),
            attachment=ros2.attachment(asked.sequence, self._wall_ns(), asked.gid),
        )

    def _key(self, topic: str, ros_type: str) -> str:
        key = ros2.native_key(
            self._node, topic=self._bus.key(topic), ros_type=ros_type, distro=self._distro
        )
        return f"/{key}"

    def _announce(self, kind: EndpointKind, topic: str, ros_type: str, qos: Qos) -> str:
        self._entities += 1
        token = ros2.endpoint_token(
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
