"""A node of ROS 2 itself: rclpy on rmw_fastrtps, its default middleware, driven by JSON lines.

`ros_node.py DOMAIN`: hears `/odom` and, as a late joiner does, `/estopped`, and prints
every message as one JSON line. It ends with its standard input:

    {"do":"drive","vx":0.1,"wz":0.0,"hz":20}
    {"do":"rest"}
    {"do":"press","data":true,"times":3}        a std_msgs/Bool on /yahboomd/estop
    {"do":"call","service":"/yahboomd/estop","data":true}
"""

import json
import os
import queue
import sys
import threading
from typing import Any

os.environ["ROS_DOMAIN_ID"] = sys.argv[1]
# The wheels are no ROS installation: this names the folder that holds their resources.
os.environ["AMENT_PREFIX_PATH"] = sys.prefix

import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

LATCHED = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
CALL_TIMEOUT_S = 5.0


def say(**line: Any) -> None:
    print(json.dumps(line), flush=True)


class Node:
    """Its publishers, subscriptions and service client."""

    def __init__(self) -> None:
        self.node = rclpy.create_node("onlooker")
        self.cmd_vel = self.node.create_publisher(Twist, "/cmd_vel", 10)
        self.button = self.node.create_publisher(Bool, "/yahboomd/estop", 10)
        self.client = self.node.create_client(SetBool, "/yahboomd/estop")
        self.twist: Twist | None = None
        self.timer: Any = None
        self.node.create_subscription(
            Odometry,
            "/odom",
            lambda m: say(
                event="message",
                topic="/odom",
                message={"x": m.pose.pose.position.x, "vx": m.twist.twist.linear.x},
            ),
            10,
        )
        self.node.create_subscription(
            Bool,
            "/estopped",
            lambda m: say(event="message", topic="/estopped", message={"data": m.data}),
            LATCHED,
        )

    def drive(self, vx: float = 0.0, wz: float = 0.0, hz: float = 20.0) -> None:
        self.twist = Twist()
        self.twist.linear.x, self.twist.angular.z = vx, wz
        self.rest()
        self.timer = self.node.create_timer(1 / hz, lambda: self.cmd_vel.publish(self.twist))

    def rest(self) -> None:
        if self.timer is not None:
            self.node.destroy_timer(self.timer)
            self.timer = None

    def press(self, data: bool, times: int = 1) -> None:
        if self.button.get_subscription_count() == 0:
            say(event="unheard")
            return
        for _ in range(times):
            self.button.publish(Bool(data=data))
        say(event="pressed")

    def call(self, service: str, data: bool) -> None:
        if not self.client.wait_for_service(CALL_TIMEOUT_S):
            say(event="no_service", service=service)
            return
        asked = self.client.call_async(SetBool.Request(data=data))
        rclpy.spin_until_future_complete(self.node, asked, timeout_sec=CALL_TIMEOUT_S)
        if asked.done():
            reply = {"success": asked.result().success, "message": asked.result().message}
            say(event="reply", service=service, reply=reply)
        else:
            say(event="no_reply", service=service)


def main() -> None:
    orders: queue.Queue[dict[str, Any] | None] = queue.Queue()

    def listen() -> None:
        for line in sys.stdin:
            orders.put(json.loads(line))
        orders.put(None)

    rclpy.init()
    node = Node()
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
