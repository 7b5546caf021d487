"""A ROS 2 node that commands and measures: ``python -m benchmarks.ros_meter PORT LOG SENT``.

Lines of JSON on the socket at PORT are velocities, [vx, wz]; each is published on ``/cmd_vel`` at
once, and noted in SENT with the time just before: [monotonic ns, vx]. Each ``/odom`` goes to LOG:
[monotonic ns at its callback, x, y, theta]. It prints ``ready`` once it has heard an ``/odom`` and
a subscriber of its commands is there. Runs in an environment with ``rclpy``, not in yahboomd's.
"""

from __future__ import annotations

import json
import math
import socket
import sys
import threading
import time
from pathlib import Path
from typing import IO

import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions


class Meter(Node):
    """Both topics."""

    def __init__(self, log: IO[str], sent: IO[str]) -> None:
        super().__init__("meter")
        self._log, self._sent = log, sent
        self._heard = False
        self._cmd_vel = self.create_publisher(Twist, "cmd_vel", 10)
        self.create_subscription(Odometry, "odom", self._odom, 10)
        self._waiting = self.create_timer(0.1, self._look)

    def say(self, vx: float, wz: float) -> None:
        """Publish a velocity."""
        twist = Twist()
        twist.linear.x, twist.angular.z = vx, wz
        self._sent.write(json.dumps([time.monotonic_ns(), vx]) + "\n")
        self._cmd_vel.publish(twist)

    def _odom(self, odom: Odometry) -> None:
        at_ns, pose = time.monotonic_ns(), odom.pose.pose
        theta = 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)
        self._log.write(json.dumps([at_ns, pose.position.x, pose.position.y, theta]) + "\n")
        self._heard = True

    def _look(self) -> None:
        if self._heard and self._cmd_vel.get_subscription_count():
            self._waiting.cancel()
            print("ready", flush=True)


def take_orders(meter: Meter, server: socket.socket) -> None:
    """Publish the velocities from the socket, until it closes."""
    connection, _ = server.accept()
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    for line in connection.makefile():
        meter.say(*json.loads(line))


if __name__ == "__main__":
    with (
        Path(sys.argv[2]).open("w", buffering=1) as log_file,
        Path(sys.argv[3]).open("w", buffering=1) as sent_file,
        socket.create_server(("127.0.0.1", int(sys.argv[1]))) as listener,
    ):
        # Any signal ends it at once: with rmw_zenoh, rclpy's own handler of SIGTERM may hang.
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        node = Meter(log_file, sent_file)
        threading.Thread(target=take_orders, args=(node, listener), daemon=True).start()
        rclpy.spin(node)
