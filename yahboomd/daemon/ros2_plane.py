"""The ROS 2 plane: which ways it takes, what it publishes, subscribes to and answers.

`BridgeWay` goes through zenoh-bridge-ros2dds: CDR on plain keys, and tokens that announce the
types. Data flow without tokens too; with them the topics show, and can be matched, before any ROS
node uses them.

`NativeWay` is a node among those of rmw_zenoh. Its keys carry domain, type and hash, so all of them
stand outside the namespace, which is part of the topics' names instead. Every sample and every
answer carries an attachment; a malformed one ends the process that receives it.
"""

from __future__ import annotations

from collections.abc import Callable
from socket import gethostname
from typing import Protocol

from yahboomd.bus import keys
from yahboomd.bus.bus import Bus
from yahboomd.bus.services import Request, Response
from yahboomd.bus.subscriptions import Arrival
from yahboomd.clock import Clock
from yahboomd.config import Config
from yahboomd.config.outputs import StaticTransform
from yahboomd.daemon.key_table import OFFERS
from yahboomd.daemon.publisher import Outlet
from yahboomd.daemon.requests import Answer, Services
from yahboomd.daemon.ros2_samples import Placed, RosPublisher, Spread, Topics
from yahboomd.messages import planar, ros2
from yahboomd.messages.codecs import encode_reply, encoding_name
from yahboomd.messages.native import ServiceReply
from yahboomd.messages.ros2 import EndpointKind, Node, Qos
from yahboomd.names import is_ros_name

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
        if not is_ros_name(self._bus.key(key)):
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


SERVICE_QOS = Qos(depth=10)

_NO_CLIENT = ros2.Attachment(sequence=1, stamp_ns=0, gid=bytes(ros2.GID_BYTES))
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

    def alarm(self, topic: str, ros_type: str, qos: Qos, hear: Callable[[str], None]) -> None:
        """Subscribe to a topic of which no sample may be lost.

        Args:
            topic: Its name below the namespace.
            ros_type: Its type.
            qos: As it is announced.
            hear: Hears it on the key given.
        """
        hear(self._key(topic, ros_type))
        self._announce("MS", topic, ros_type, qos)

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
        asked = ros2.parse_attachment(request.attachment or b"") or _NO_CLIENT
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


COMMANDS = Qos(reliable=False, depth=1)
"""Only the newest counts; and it becomes the QoS of the bridge's DDS reader, which so takes the
commands of any writer, reliable or not."""

ESTOP_QOS = Qos(reliable=True, depth=10)
"""No press may be lost on DDS, so a publisher has to be reliable, as ROS 2's are by default. Not
latched: a press of yesterday must not stop the robot again whenever the bridge restarts."""

SERVICES = {key: offer.ros_type for key, offer in OFFERS.items() if offer.ros_type}
"""The services whose requests ROS 2 has types for."""

Handler = Callable[[list[Arrival]], None]


def start(
    bus: Bus,
    config: Config,
    clock: Clock,
    *,
    services: Services,
    commands: Callable[[str], Handler],
) -> RosPublisher:
    """Enter ROS 2's graphs, as far as configured.

    Args:
        bus: An open session, on which the services and the plain command keys are there already.
        config: Which ways, and all names.
        clock: What tells the time.
        services: Carry out what is asked natively.
        commands: What to hand a source's commands to that arrive natively.

    Returns:
        Publishes readings and status. Without any way it publishes nothing.
    """
    bridge = BridgeWay(bus, config.ros2.distro) if config.ros2.bridge else None
    native = None
    if config.ros2.rmw_zenoh:
        native = NativeWay(
            bus,
            domain_id=config.ros2.domain_id,
            distro=config.ros2.distro,
            wall_ns=clock.wall_ns,
        )
    ways = [way for way in (bridge, native) if way is not None]

    def open_topic(topic: str, ros_type: str, qos: Qos) -> Spread:
        outlets = tuple(way.publisher(topic, ros_type, qos) for way in ways)
        return Spread(outlets, outlets[:1] if bridge is not None else ())

    # Services and commands come before samples: the e-stop first. As a topic besides, because the
    # bridge drops the service calls of rmw_fastrtps, the default of ROS 2.
    if bridge is not None:
        bridge.subscriber(keys.ESTOP, ros2.BOOL, ESTOP_QOS)
    if native is not None:
        native.alarm(keys.ESTOP, ros2.BOOL, ESTOP_QOS, lambda at: services.hear_estop(bus, at))
    for key, ros_type in SERVICES.items():
        if bridge is not None:
            bridge.service(key, ros_type)
        if native is not None:
            _serve(bus, native, services, key)
    for source in filter(is_ros_name, config.command.sources):
        stamped = source in config.ros2.stamped_commands
        ros_type = ros2.TWIST_STAMPED if stamped else ros2.TWIST
        if bridge is not None:
            bridge.subscriber(source, ros_type, COMMANDS)
        if native is not None:
            other = ros2.TWIST if stamped else ros2.TWIST_STAMPED
            native.subscriber(source, ros_type, COMMANDS, commands(source), also=other)
    publisher = RosPublisher(open_topic, topics(config), clock)
    publisher.place()
    return publisher


def topics(config: Config) -> Topics:
    """The topics as configured, with the prefix in front of every frame."""
    chosen, odometry = config.ros2, config.odometry
    prefix = chosen.frame_prefix
    motors = config.motors()
    return Topics(
        odom=chosen.odom_topic if chosen.odom else "",
        transform=chosen.publish_tf,
        joint_states=chosen.joint_states_topic if chosen.joint_states else "",
        battery_state=chosen.battery_state_topic if chosen.battery_state else "",
        diagnostics=chosen.diagnostics_topic if chosen.diagnostics else "",
        frame_id=prefix + odometry.frame_id,
        child_frame_id=prefix + odometry.child_frame_id,
        static=tuple(_placed(prefix, each) for each in chosen.static_transforms),
        joints=tuple(config.joint_name(motor.name) for motor in motors),
        radii_m=tuple(motor.radius_m for motor in motors),
        hardware_id=chosen.hardware_id or config.zenoh.namespace or gethostname(),
        battery_curve=config.board.battery_curve,
    )


def _placed(prefix: str, transform: StaticTransform) -> Placed:
    return Placed(
        parent=prefix + transform.parent,
        child=prefix + transform.child,
        position_m=(transform.x, transform.y, transform.z),
        rotation=planar.rotation(transform.roll, transform.pitch, transform.yaw),
    )


def _serve(bus: Bus, native: NativeWay, services: Services, key: str) -> None:
    native.service(
        key,
        SERVICES[key],
        lambda at, answer: services.offer(bus, key, services.actions[key], answer, at=at),
    )
