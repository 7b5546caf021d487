"""A node of zenoh-ros2-sdk, which speaks rmw_zenoh's protocol without ROS 2, driven by JSON lines.

`sdk_node.py ENDPOINT DOMAIN NAME`: hears `/chatter`, `/odom` and `/cmd_vel`, and prints each
message as a JSON line. It ends with its standard input:

    {"do":"talk","text":"hello"}                a std_msgs/String on /chatter
    {"do":"drive","vx":0.1,"hz":20}             geometry_msgs/Twist on /cmd_vel
    {"do":"rest"}
    {"do":"press","data":true}                  a std_msgs/Bool on /yahboomd/estop
    {"do":"call","service":"/yahboomd/estop","data":true}    without "data": a Trigger
"""

import json
import os
import queue
import sys
import threading
import time

from rosbags.typesys import Stores, get_typestore
from zenoh_ros2_sdk import ROS2Publisher, ROS2ServiceClient, ROS2Subscriber

endpoint, domain, name = sys.argv[1:]
host, port = endpoint.rpartition("/")[2].rsplit(":", 1)
os.environ["ROS_DOMAIN_ID"] = domain

TYPES = get_typestore(Stores.ROS2_JAZZY)
AT = {"router_ip": host, "router_port": int(port), "node_name": name}
REPLY = "bool success\nstring message"
SERVICES = {
    "SetBool": {"request_definition": "bool data"},
    # It takes an empty definition for none, so the member that stands for it, and the known hash.
    "Trigger": {
        "request_definition": "uint8 structure_needs_at_least_one_member",
        "type_hash": "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f",
    },
}


def of_type(ros_type):
    """The definition of a type with all below it, and its hash: the SDK would clone them."""
    text, _ = TYPES.generate_msgdef(ros_type, ros_version=2)
    return {
        "msg_type": ros_type,
        "msg_definition": text,
        "type_hash": TYPES.hash_rihs01(ros_type),
    } | AT


def say(**line):
    # One write: messages are heard on threads of their own.
    sys.stdout.write(json.dumps(line) + "\n")
    sys.stdout.flush()


class Node:
    def __init__(self):
        self.publishers = {}
        self.clients = {}
        self.due_s = self.period_s = None
        self.vx = 0.0
        self.heard = [
            ROS2Subscriber(topic, callback=self.hearing(topic, read), **of_type(ros_type))
            for topic, ros_type, read in (
                ("/chatter", "std_msgs/msg/String", lambda m: m.data),
                ("/odom", "nav_msgs/msg/Odometry", lambda m: m.twist.twist.linear.x),
                ("/cmd_vel", "geometry_msgs/msg/Twist", lambda m: m.linear.x),
            )
        ]

    @staticmethod
    def hearing(topic, read):
        return lambda message: say(event="message", topic=topic, message=read(message))

    def publish(self, topic, ros_type, **fields):
        if topic not in self.publishers:
            self.publishers[topic] = ROS2Publisher(topic, **of_type(ros_type))
        self.publishers[topic].publish(**fields)

    def talk(self, text):
        self.publish("/chatter", "std_msgs/msg/String", data=text)

    def press(self, data):
        self.publish("/yahboomd/estop", "std_msgs/msg/Bool", data=data)

    def drive(self, vx, hz=20.0):
        self.vx, self.period_s, self.due_s = vx, 1 / hz, time.monotonic()

    def rest(self):
        self.due_s = None

    def command(self):
        vector = TYPES.types["geometry_msgs/msg/Vector3"]
        linear, angular = vector(self.vx, 0.0, 0.0), vector(0.0, 0.0, 0.0)
        self.publish("/cmd_vel", "geometry_msgs/msg/Twist", linear=linear, angular=angular)
        self.due_s += self.period_s

    def call(self, service, data=None):
        kind = "Trigger" if data is None else "SetBool"
        if service not in self.clients:
            of = {"response_definition": REPLY, **SERVICES[kind], **AT}
            self.clients[service] = ROS2ServiceClient(service, f"std_srvs/srv/{kind}", **of)
        fields = {"structure_needs_at_least_one_member": 0} if data is None else {"data": data}
        reply = self.clients[service].call(**fields)
        if reply is None:
            say(event="no_reply", service=service)
        else:
            found = {"success": reply.success, "message": reply.message}
            say(event="reply", service=service, reply=found)


def main():
    orders = queue.Queue()
    threading.Thread(target=lambda: [*map(orders.put, sys.stdin), orders.put("")]).start()
    node = Node()
    say(event="ready")
    while True:
        wait_s = None if node.due_s is None else max(0.0, node.due_s - time.monotonic())
        try:
            line = orders.get(timeout=wait_s)
        except queue.Empty:
            node.command()
            continue
        if not line:
            break
        order = json.loads(line)
        getattr(node, order.pop("do"))(**order)
    os._exit(0)  # its sessions wait for a second, and for nothing


if __name__ == "__main__":
    main()
