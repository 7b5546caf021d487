"""The ROS 2 plane: its ways, its topics, its subscriptions and its services."""

from __future__ import annotations

from functools import partial
from socket import gethostname

from yahboomd.core.bus import keys
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.subscriptions import Arrival
from yahboomd.core.clock import Clock
from yahboomd.core.config import Config
from yahboomd.core.config.outputs import StaticTransform
from yahboomd.core.daemon.planes import Guard, PlaneRequests
from yahboomd.core.names import is_ros_name
from yahboomd.ros2.messages import planar, ros2_names
from yahboomd.ros2.messages.ros2_names import Qos
from yahboomd.ros2.ros2_parameters import parameter_server
from yahboomd.ros2.ros2_samples import Placed, RosPublisher, Spread, Topics
from yahboomd.ros2.ros2_topics import SERVICES
from yahboomd.ros2.ros2_types import TypeWatch
from yahboomd.ros2.ros2_ways import BridgeWay, NativeWay

COMMANDS = Qos(reliable=False, depth=1)
"""Only the newest counts; and it becomes the QoS of the bridge's DDS reader, which so takes the
commands of any writer, reliable or not."""

REPEATED = Qos(reliable=False, depth=10)
"""Of the e-stop and of poses: a person publishes them several times, from a process that ends soon.

A reliable reader gets nothing from a fresh writer of FastDDS before their handshake is complete,
which takes a second, and a writer that ends before that is never heard. Not latched: a press of
yesterday must not stop the robot again when the bridge restarts."""

USUAL_NAMES = {
    "e_stop_trigger": keys.ESTOP,
    "e_stop_reset": keys.ESTOP_RESET,
    "odometry_reset": keys.ODOMETRY_RESET,
}
"""Second names of services, natively, each a Trigger: the e-stop's are those of other bases. Behind
the bridge the resident of the bring-up package serves them."""


class Ros2Plane:
    """The plane of ROS 2; the configuration that the daemon hands it decides what it has."""

    name = "ROS 2"

    def start(
        self, bus: Bus, config: Config, clock: Clock, requests: PlaneRequests, guarded: Guard
    ) -> RosPublisher:
        """Enter ROS 2's graphs, as far as configured.

        Returns:
            Publishes readings and status. Without any way it publishes nothing.
        """
        services = requests.services
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
        types = TypeWatch(bus, guarded)

        def open_topic(topic: str, ros_type: str, qos: Qos) -> Spread:
            if bridge is not None:
                types.routes.watch(topic)
            outlets = tuple(way.publisher(topic, ros_type, qos) for way in ways)
            return Spread(outlets, outlets[:1] if bridge is not None else ())

        def serve(way: NativeWay, name: str, key: str, ros_type: str) -> None:
            action = services.actions[key]
            offer = partial(services.offer, bus, key, action)
            way.service(name, ros_type, lambda at, answer: offer(answer, at=at))

        # Services and commands come before samples: the e-stop first. As a topic besides, because
        # the bridge drops the service calls of rmw_fastrtps, the default of ROS 2.
        if bridge is not None:
            bridge.subscriber(keys.ESTOP, ros2_names.BOOL, REPEATED)
        if native is not None:
            native.alarm(
                keys.ESTOP, ros2_names.BOOL, REPEATED, lambda at: services.hear_estop(bus, at)
            )
        for key, ros_type in SERVICES.items():
            if bridge is not None:
                bridge.service(key, ros_type)
            if native is not None:
                serve(native, key, key, ros_type)
        if native is not None:
            for name, key in USUAL_NAMES.items():
                serve(native, name, key, ros2_names.TRIGGER)
            native.parameters(parameter_server(config))
        sent_at = guarded("The time of sending", sent_ns)
        for source in filter(is_ros_name, config.command.sources):
            stamped = source in config.ros2.stamped_commands
            ros_type = ros2_names.TWIST_STAMPED if stamped else ros2_names.TWIST
            if bridge is not None:
                bridge.subscriber(source, ros_type, COMMANDS)
                types.watch_bridges(source, ros_type)
            if native is not None:
                other = ros2_names.TWIST if stamped else ros2_names.TWIST_STAMPED
                handler = requests.commands(source, sent_at)
                native.subscriber(source, ros_type, COMMANDS, handler, also=other)
                types.watch_nodes(source, ros_type, config.ros2.domain_id)
        own = topics(config)
        for topic in filter(None, (own.odom, own.joint_states)):
            # Other publishers of these are a fault.
            if bridge is not None:
                types.watch_bridges(topic, "")
            if native is not None:
                types.watch_nodes(topic, "", config.ros2.domain_id)
        if bridge is not None:
            bridge.subscriber(keys.ODOMETRY_SET_POSE, ros2_names.POSE, REPEATED)
        if native is not None:
            native.subscriber(keys.ODOMETRY_SET_POSE, ros2_names.POSE, REPEATED, requests.poses)
        publisher = RosPublisher(open_topic, topics(config), clock, types.warnings)
        publisher.place()
        return publisher


def sent_ns(arrival: Arrival) -> int | None:
    """When a node of rmw_zenoh sent a sample, Unix ns, by its attachment; None if that is none."""
    attachment = ros2_names.parse_attachment(arrival.attachment or b"")
    return attachment.stamp_ns if attachment is not None and attachment.stamp_ns > 0 else None


def topics(config: Config) -> Topics:
    chosen, odometry = config.ros2, config.odometry
    prefix = chosen.frame_prefix
    motors = config.motors()
    return Topics(
        odom=chosen.odom_topic if chosen.odom else "",
        transform=chosen.publish_tf,
        joint_states=chosen.joint_states_topic if chosen.joint_states else "",
        imu=chosen.imu_topic if chosen.imu else "",
        imu_frame_id=prefix + config.imu.frame_id,
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
