"""The article's bridge as the ROS 2 node that it is: ``python -m benchmarks.ros_article PTY``.

Written from the description in "Building a ROS 2 Hardware Bridge for Yahboom 520 Motor Drivers":
one process owns the port; it sends ``$mtype:1#``, writes ``$speed:L,0,R,0#`` in the callback of
``/cmd_vel``, asks ``$read#`` in a timer 20 times a second, integrates ``$data:A,B,C,D#`` into a
pose, publishes it on ``/odom``, and stops the wheels when it ends. The law is that of ``article``;
here ``rclpy`` calls it, in its single-threaded executor. No transform is published, which makes it
cheaper. Runs in an environment with ``rclpy``, not in yahboomd's.
"""

from __future__ import annotations

import contextlib
import io
import math
import sys

import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

from benchmarks.article import PERIOD_S, Bridge


class BridgeNode(Node):
    """Serial port in, ``/odom`` out."""

    def __init__(self, path: str) -> None:
        super().__init__("yahboom_bridge")
        self.bridge = Bridge(path, io.StringIO())
        self._odom = self.create_publisher(Odometry, "odom", 10)
        self.create_subscription(Twist, "cmd_vel", self._velocity, 10)
        self.create_timer(PERIOD_S, self._poll)

    def _velocity(self, twist: Twist) -> None:
        self.bridge.velocity(twist.linear.x, twist.angular.z)

    def _poll(self) -> None:
        before = self.bridge.readings
        self.bridge.poll()
        if self.bridge.readings == before:
            return
        odom = Odometry()
        odom.header.stamp = self.get_clock().now().to_msg()
        odom.header.frame_id = "odom"
        odom.child_frame_id = "base_link"
        odom.pose.pose.position.x = self.bridge.x
        odom.pose.pose.position.y = self.bridge.y
        odom.pose.pose.orientation.z = math.sin(self.bridge.theta / 2.0)
        odom.pose.pose.orientation.w = math.cos(self.bridge.theta / 2.0)
        self._odom.publish(odom)


if __name__ == "__main__":
    rclpy.init()
    node = BridgeNode(sys.argv[1])
    print("ready", flush=True)
    try:
        with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
            rclpy.spin(node)
    finally:
        node.bridge.stop()
