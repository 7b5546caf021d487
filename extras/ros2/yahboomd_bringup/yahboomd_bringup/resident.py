"""A node that stays: it keeps the bridge's routes, and serves what the bridge drops of FastDDS.

The bridge knows nodes by name. When the lease of a killed node ends, it removes the route that a
new node of that name needs (zenoh-plugin-ros2dds #702, #705), unless another node subscribes, too.
So this one subscribes to each topic of the bridge that a node has read once, and reads none.

It needs `rclpy`, and for its services the program `yahboomd`:

    ros2 run yahboomd_bringup resident -- --config /etc/yahboomd/config.toml
"""

import argparse
import importlib
import json
import secrets
import subprocess
import sys
from contextlib import suppress
from typing import Callable, List, Set, Tuple

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.utilities import remove_ros_args
from std_srvs.srv import Trigger

Serve = Callable[[Trigger.Request, Trigger.Response], Trigger.Response]

SERVICES = {
    "e_stop_trigger": "estop",
    "e_stop_reset": "estop/reset",
    "odometry_reset": "odometry/reset",
}
"""Names of their own: a request under the bridge's names would be answered twice."""

LOOK_EVERY_S = 1.0
CALL_TIMEOUT_S = 30.0


class Resident:
    """The node.

    Args:
        bridge: The name of the bridge's node.
        call: The command that calls a service of yahboomd, without the service.
    """

    def __init__(self, bridge: str, call: List[str]) -> None:
        self.bridge = bridge
        self.call = call
        self.kept: Set[str] = set()
        # A name of each start's own: it may be killed and start again, too.
        name = f"yahboomd_resident_{secrets.token_hex(4)}"
        self.node = rclpy.create_node(name)
        # Never spun: its messages are received and not read, which costs next to nothing.
        self.keeper = rclpy.create_node(f"{name}_routes")
        self.node.create_timer(LOOK_EVERY_S, self.keep)
        for service, key in SERVICES.items():
            self.node.create_service(Trigger, service, self.serving(key))

    def keep(self) -> None:
        """Subscribe to each further topic of the bridge that has a reader."""
        below = self.node.get_namespace().rstrip("/") + "/"
        for topic, types in self.node.get_topic_names_and_types():
            if topic in self.kept or not topic.startswith(below):
                continue
            writers = [
                each
                for each in self.node.get_publishers_info_by_topic(topic)
                if each.node_name == self.bridge
            ]
            if writers and self.node.count_subscribers(topic):
                self.kept.add(topic)
                self.subscribe(topic, types[0], writers[0].qos_profile)

    def subscribe(self, topic: str, ros_type: str, offered: QoSProfile) -> None:
        """As the bridge offers it: its next life takes its QoS from the readers that it finds."""
        package, kind, message = ros_type.split("/")
        try:
            found = getattr(importlib.import_module(f"{package}.{kind}"), message)
        except ImportError:
            self.node.get_logger().warning(f"{topic} is not kept: {ros_type} is not installed.")
            return
        qos = QoSProfile(
            depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=offered.durability
        )
        self.keeper.create_subscription(found, topic, lambda _message: None, qos)
        self.node.get_logger().info(f"{topic} is kept.")

    def serving(self, key: str) -> Serve:
        """The callback of a service."""

        def serve(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            response.success, response.message = called([*self.call, key])
            return response

        return serve


def called(command: List[str]) -> Tuple[bool, str]:
    """Whether a service of yahboomd did it, and its answer."""
    try:
        ended = subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=CALL_TIMEOUT_S
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return False, f"No answer, so it may or may not be done: {error}"
    answers = [json.loads(line)["message"] for line in ended.stdout.splitlines()]
    return ended.returncode == 0, " ".join(answers) or ended.stderr.strip()


def main() -> None:
    """Stay until a signal."""
    parser = argparse.ArgumentParser(
        prog="resident",
        description="Keep the bridge's routes, and serve e-stop and resets to every middleware. "
        "Further options are those of `yahboomd call`, such as --config or --connect.",
    )
    parser.add_argument("--bridge", default="zenoh_bridge_ros2dds", help="nodename of the bridge")
    parser.add_argument("--yahboomd", default="yahboomd", help="the program")
    rclpy.init()
    known, options = parser.parse_known_args(remove_ros_args(sys.argv)[1:])
    resident = Resident(known.bridge, [known.yahboomd, "call", *options])
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(resident.node)


if __name__ == "__main__":
    main()
