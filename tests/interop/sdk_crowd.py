"""Nodes of zenoh-ros2-sdk that come and go: `sdk_crowd.py ENDPOINT DOMAIN NODES`.

Each has a session of its own, hears `/chatter`, and says its number there. It prints `ready` once
all are there, and a JSON line for each one that has been replaced. It ends with its standard input.
"""

import itertools
import json
import os
import sys
import threading

from zenoh_ros2_sdk import ROS2Publisher, ROS2Subscriber
from zenoh_ros2_sdk.session import ZenohSession

endpoint, domain, count = sys.argv[1:]
host, port = endpoint.rpartition("/")[2].rsplit(":", 1)
os.environ["ROS_DOMAIN_ID"] = domain

HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"


class Node:
    def __init__(self, number):
        # The SDK shares one session between all nodes of a process.
        ZenohSession._instance = self.shared = ZenohSession(host, int(port))
        of = {"msg_type": "std_msgs/msg/String", "msg_definition": "string data"}
        of |= {"type_hash": HASH, "node_name": f"crowd_{number}"}
        self.subscriber = ROS2Subscriber("/chatter", callback=lambda _: None, **of)
        self.publisher = ROS2Publisher("/chatter", **of)
        self.publisher.publish(data=str(number))

    def leave(self):
        self.shared.session.close()


def say(**line):
    print(json.dumps(line), flush=True)


def main():
    numbers = itertools.count()
    nodes = [Node(next(numbers)) for _ in range(int(count))]
    say(event="ready")
    over = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), over.set()), daemon=True).start()
    while not over.wait(0.2):
        nodes.pop(0).leave()
        nodes.append(Node(next(numbers)))
        say(event="replaced", last=len(nodes))
    os._exit(0)


if __name__ == "__main__":
    main()
