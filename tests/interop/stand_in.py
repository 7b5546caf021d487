"""A node in place of one that is not available: `stand_in.py PROGRAM ARGUMENTS`, as it is started.

Prints its name, topics and parameters as a JSON line. With ACTS in its environment it also does
what its program does with transforms and scans, on the topics and in the frames that it is given:
it publishes its frames, and prints each transform and each scan that it hears, once.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import sys
import threading
from xml.etree import ElementTree

import rclpy
from geometry_msgs.msg import TransformStamped, Twist
from rclpy.executors import ExternalShutdownException
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState, LaserScan

TOPICS = ("cmd_vel", "/tf", "/tf_static", "joint_states")
LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
MOVED_M = 0.05
COSTMAPS = {
    "controller_server": ("local_costmap", "voxel_layer.scan.topic"),
    "planner_server": ("global_costmap", "obstacle_layer.scan.topic"),
}


def say(**line):
    print(json.dumps(line), flush=True)


class StandIn:
    """One node, and the costmap's beside it if its program has one."""

    def __init__(self, program):
        self.node = rclpy.create_node(program, automatically_declare_parameters_from_overrides=True)
        self.name = self.node.get_fully_qualified_name()
        self.told = set()
        self.publishers = {}
        say(
            event="node",
            name=self.name,
            topics={name: self.node.resolve_topic_name(name) for name in TOPICS},
            parameters={
                name: parameter.value
                for name, parameter in self.node.get_parameters_by_prefix("").items()
                if name != "use_sim_time"
            },
        )
        self.nodes = [self.node]
        if "ACTS" in os.environ and (part := getattr(self, program, None)):
            part()

    def once(self, **line):
        if (key := tuple(line.values())) not in self.told:
            self.told.add(key)
            say(**line, node=self.name)

    def value(self, name):
        return self.node.get_parameter(name).value

    # What it says.

    def publish(self, topic, *frames):
        """Transforms without a translation, each (parent, child)."""
        from tf2_msgs.msg import TFMessage

        if topic not in self.publishers:
            qos = LATCHED if topic == "/tf_static" else 100
            self.publishers[topic] = self.node.create_publisher(TFMessage, topic, qos)
        message = TFMessage()
        for parent, child in frames:
            each = TransformStamped(child_frame_id=child)
            each.header.frame_id = parent
            each.header.stamp = self.node.get_clock().now().to_msg()
            each.transform.rotation.w = 1.0
            message.transforms.append(each)
            resolved = self.node.resolve_topic_name(topic)
            self.once(event="says", topic=resolved, parent=parent, child=child)
        self.publishers[topic].publish(message)

    def lidar(self):
        """A driver, which ends with its standard input; by its ranges its scans are known."""
        publisher = self.node.create_publisher(LaserScan, "scan", 10)
        scan = LaserScan(ranges=[float(os.environ["ACTS"])] * 4)
        scan.header.frame_id = "laser"
        self.node.create_timer(0.1, lambda: publisher.publish(scan))
        threading.Thread(target=lambda: (sys.stdin.read(), rclpy.shutdown()), daemon=True).start()
        say(event="ready")

    def robot_state_publisher(self):
        prefix = self.value("frame_prefix")
        joints = {}
        for joint in ElementTree.fromstring(self.value("robot_description")).iter("joint"):
            ends = tuple(prefix + joint.find(end).get("link") for end in ("parent", "child"))
            joints[joint.get("name")] = (joint.get("type"), ends)
        self.publish("/tf_static", *(ends for kind, ends in joints.values() if kind == "fixed"))
        self.node.create_subscription(
            JointState,
            "joint_states",
            lambda heard: self.publish("/tf", *(joints[name][1] for name in heard.name)),
            10,
        )

    def async_slam_toolbox_node(self):
        self.transforms()
        self.scans(self.node, "scan_topic")
        frames = (self.value("map_frame"), self.value("odom_frame"))
        self.node.create_timer(0.1, lambda: self.publish("/tf", frames))

    # What it hears.

    def transforms(self):
        from tf2_msgs.msg import TFMessage

        for name, qos in (("/tf", 100), ("/tf_static", LATCHED)):
            topic = self.node.resolve_topic_name(name)
            self.node.create_subscription(TFMessage, name, self.hears(topic), qos)

    def hears(self, topic):
        def heard(message):
            for each in message.transforms:
                frames = {"parent": each.header.frame_id, "child": each.child_frame_id}
                self.once(event="frame", topic=topic, **frames)
                place = each.transform.translation
                if topic.endswith("/tf") and math.hypot(place.x, place.y) > MOVED_M:
                    self.once(event="moved", topic=topic, **frames)

        return heard

    def scans(self, node, parameter):
        name = node.get_parameter(parameter).value
        topic = node.resolve_topic_name(name)

        def heard(scan):
            self.once(event="scan", topic=topic, of=scan.ranges[0])

        node.create_subscription(LaserScan, name, heard, 10)

    def costmap(self, program):
        """A node of its own, as Nav2's is; its transforms come by a third one, beside ours."""
        self.transforms()
        name, parameter = COSTMAPS[program]
        below = f"__ns:={self.node.get_namespace().rstrip('/')}/{name}"
        beside = rclpy.create_node(
            name,
            cli_args=["--ros-args", "-r", below, "-r", f"__node:={name}"],
            automatically_declare_parameters_from_overrides=True,
        )
        self.nodes.append(beside)
        self.scans(beside, parameter)

    def controller_server(self):
        self.costmap("controller_server")

    def planner_server(self):
        self.costmap("planner_server")

    def behavior_server(self):
        self.transforms()

    def bt_navigator(self):
        self.transforms()

    def collision_monitor(self):
        """The last one before the wheels."""
        self.transforms()
        self.scans(self.node, "scan.topic")
        publisher = self.node.create_publisher(Twist, self.value("cmd_vel_out_topic"), 10)
        command = Twist()
        command.linear.x = float(os.environ["ACTS"])
        self.node.create_timer(0.05, lambda: publisher.publish(command))


def main():
    rclpy.init(args=[sys.argv[0], *sys.argv[2:]])
    executor = rclpy.executors.SingleThreadedExecutor()
    for node in StandIn(sys.argv[1]).nodes:
        executor.add_node(node)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        executor.spin()


if __name__ == "__main__":
    main()
