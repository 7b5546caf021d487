"""A node of ROS 2 itself: rclpy on rmw_fastrtps, its default middleware, driven by JSON lines.

`ros_node.py DOMAIN [CONSUMER ...]`: subscribes as the named programs do (`CONSUMERS`; none named:
to `/odom` and, latched, `/estopped`), and prints every message as one JSON line. It ends with its
standard input:

    {"do":"drive","vx":0.1,"wz":0.0,"hz":20}    with "stamped":true: a TwistStamped
    {"do":"rest"}
    {"do":"press","data":true,"times":3}        a std_msgs/Bool on /yahboomd/estop
    {"do":"talk","text":"hello"}                a std_msgs/String on /chatter
    {"do":"call","service":"/yahboomd/estop","data":true}    without "data": a Trigger
    {"do":"graph"}
    {"do":"measure"}                            from now on print nothing, only note arrivals
    {"do":"ramp","count":1000}                  commands that are all different, 30 to 70 ms apart
    {"do":"measured"}                           print the noted arrivals
"""

import json
import os
import queue
import random
import sys
import threading
import time
from collections.abc import Callable
from itertools import takewhile
from typing import Any

os.environ["ROS_DOMAIN_ID"] = sys.argv[1]
# The wheels are no ROS installation: this names the folder that holds their resources.
os.environ["AMENT_PREFIX_PATH"] = sys.prefix

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import Log
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSProfile,
    ReliabilityPolicy,
    qos_profile_system_default,
)
from sensor_msgs.msg import BatteryState, Imu, JointState
from std_msgs.msg import Bool, String
from std_srvs.srv import SetBool, Trigger

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # it is generated, which needs a compiler
    TFMessage = None


def reliable(depth: int, *, latched: bool = False) -> QoSProfile:
    return QoSProfile(
        depth=depth,
        history=HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def best_effort(depth: int) -> QoSProfile:
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)


CONSUMERS: dict[str, list[tuple[str, Any, QoSProfile]]] = {
    "": [
        ("/odom", Odometry, reliable(10)),
        ("/estopped", Bool, reliable(1, latched=True)),
    ],
    # rviz_common, qos_profile_property.hpp and ros_topic_display.hpp: QoS(5)
    "rviz": [("/odom", Odometry, reliable(5))],
    # nav2_util, odometry_utils.cpp up to Jazzy: SystemDefaultsQoS
    "nav2": [("/odom", Odometry, qos_profile_system_default)],
    # nav2_ros_common, qos_profiles.hpp since: StandardTopicQoS
    "nav2_newer": [("/odom", Odometry, reliable(10))],
    # tf2_ros, qos.hpp: DynamicListenerQoS and StaticListenerQoS
    "tf2_ros": [
        ("/tf", TFMessage, reliable(100)),
        ("/tf_static", TFMessage, reliable(100, latched=True)),
    ],
    # robot_localization, ros_filter.cpp: SensorDataQoS(KeepLast(queue_size)), which is 10
    "robot_localization": [("/odom", Odometry, best_effort(10))],
    # its robot_state_publisher.cpp has SensorDataQoS
    "robot_state_publisher": [("/joint_states", JointState, best_effort(5))],
    # `ros2 topic echo` and rqt_robot_monitor
    "panel": [
        ("/battery_state", BatteryState, reliable(10)),
        ("/diagnostics", DiagnosticArray, qos_profile_system_default),
        ("/estopped", Bool, reliable(1, latched=True)),
    ],
    # robot_localization again
    "imu": [
        ("/imu/data_raw", Imu, best_effort(10)),
        ("/imu/data", Imu, best_effort(10)),
    ],
    # demo_nodes_py's listener
    "chatter": [("/chatter", String, reliable(10))],
    # `ros2 topic echo /rosout`, which takes the QoS of the publishers
    "log": [("/rosout", Log, reliable(1000, latched=True))],
}
"""The subscriptions of ROS 2 programs, with the QoS of their sources."""

SERVICES = {
    "/yahboomd/estop": SetBool,
    "/yahboomd/estop/reset": Trigger,
    "/yahboomd/odometry/reset": Trigger,
    # Those of the resident.
    "/e_stop_trigger": Trigger,
    "/e_stop_reset": Trigger,
    "/odometry_reset": Trigger,
}
CALL_TIMEOUT_S = float(os.environ.get("CALL_TIMEOUT_S", "30"))


def say(**line: Any) -> None:
    print(json.dumps(line), flush=True)


def plain(value: Any) -> Any:
    """A message as JSON has it."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):  # a ROS byte
        return value[0]
    if hasattr(value, "tolist"):
        return value.tolist()
    return [plain(each) for each in value] if isinstance(value, (list, tuple)) else value


def stamp_ns(message: Any) -> int:
    stamped = message.transforms[0] if hasattr(message, "transforms") else message
    stamp = stamped.header.stamp
    return int(stamp.sec * 1_000_000_000 + stamp.nanosec)


class Node:
    """Its publishers, subscriptions and service clients."""

    def __init__(self, consumers: list[str]) -> None:
        self.node = rclpy.create_node(os.environ.get("ROS_NODE_NAME", "onlooker"))
        self.chatter = self.node.create_publisher(String, "/chatter", 10)
        self.button = self.node.create_publisher(Bool, "/yahboomd/estop", 10)
        self.cmd_vel: Any = None
        self.clients: dict[str, Any] = {}
        self.timer: Any = None
        self.noted: dict[str, list[tuple[int, int]]] | None = None
        self.commands: list[tuple[int, float]] = []
        for consumer in consumers:
            for topic, kind, qos in CONSUMERS[consumer]:
                heard = self.hearing(consumer, topic)
                self.node.create_subscription(kind, topic, heard, qos)

    def hearing(self, consumer: str, topic: str) -> Callable[[Any], None]:
        def heard(message: Any) -> None:
            if self.noted is None:
                say(event="message", topic=topic, consumer=consumer, message=plain(message))
            elif hasattr(message, "header") or hasattr(message, "transforms"):
                arrivals = self.noted.setdefault(f"{topic} {consumer}", [])
                arrivals.append((stamp_ns(message), time.time_ns()))

        return heard

    def publish(self, vx: float, vy: float, wz: float, *, stamped: bool) -> None:
        """One command; the first one creates the publisher of its type."""
        if self.cmd_vel is None:
            kind = TwistStamped if stamped else Twist
            self.cmd_vel = self.node.create_publisher(kind, "/cmd_vel", 10)
        command = TwistStamped() if stamped else Twist()
        twist = command
        if stamped:
            command.header.stamp = self.node.get_clock().now().to_msg()
            twist = command.twist
        twist.linear.x, twist.linear.y, twist.angular.z = vx, vy, wz
        self.commands.append((time.monotonic_ns(), vx))
        self.cmd_vel.publish(command)

    def drive(
        self,
        vx: float = 0.0,
        vy: float = 0.0,
        wz: float = 0.0,
        hz: float = 20.0,
        *,
        stamped: bool = False,
    ) -> None:
        self.rest()
        self.timer = self.node.create_timer(
            1 / hz, lambda: self.publish(vx, vy, wz, stamped=stamped)
        )

    def rest(self) -> None:
        if self.timer is not None:
            self.node.destroy_timer(self.timer)
            self.timer = None

    def ramp(self, count: int) -> None:
        chance = random.Random(3)
        for n in range(count):
            self.publish((300 + n % 100 + 0.4) / 1000, 0.0, 0.0, stamped=False)
            due_s = time.monotonic() + chance.uniform(0.03, 0.07)
            while (left_s := due_s - time.monotonic()) > 0:
                rclpy.spin_once(self.node, timeout_sec=left_s)
        say(event="ramped")

    def press(self, data: bool, times: int = 1) -> None:
        if self.button.get_subscription_count() == 0:
            say(event="unheard")
            return
        for _ in range(times):
            self.button.publish(Bool(data=data))
        say(event="pressed")

    def talk(self, text: str) -> None:
        self.chatter.publish(String(data=text))

    def call(self, service: str, data: bool | None = None) -> None:
        kind = SERVICES[service]
        if service not in self.clients:
            self.clients[service] = self.node.create_client(kind, service)
        client = self.clients[service]
        if not client.wait_for_service(30.0):
            say(event="no_service", service=service)
            return
        request = kind.Request() if data is None else kind.Request(data=data)
        asked = client.call_async(request)
        rclpy.spin_until_future_complete(self.node, asked, timeout_sec=CALL_TIMEOUT_S)
        if asked.done():
            say(event="reply", service=service, reply=plain(asked.result()))
        else:
            say(event="no_reply", service=service)

    def graph(self) -> None:
        topics = dict(self.node.get_topic_names_and_types())
        services = dict(self.node.get_service_names_and_types())
        say(event="graph", graph={"topics": topics, "services": services})

    def measure(self) -> None:
        self.noted = {}
        self.commands = []
        say(event="measuring")

    def measured(self) -> None:
        say(event="measured", arrivals=self.noted, commands=self.commands)
        self.noted = None


def main() -> None:
    orders: queue.Queue[dict[str, Any] | None] = queue.Queue()

    def listen() -> None:
        for line in sys.stdin:
            orders.put(json.loads(line))
        orders.put(None)

    rclpy.init(args=sys.argv)
    node = Node(list(takewhile("--ros-args".__ne__, sys.argv[2:])) or [""])
    threading.Thread(target=listen, daemon=True).start()
    say(event="ready", middleware=rclpy.get_rmw_implementation_identifier())
    while True:
        rclpy.spin_once(node.node, timeout_sec=0.01)
        try:
            order = orders.get_nowait()
        except queue.Empty:
            continue
        if order is None:
            break
        getattr(node, order.pop("do"))(**order)
    node.node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
