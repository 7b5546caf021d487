"""What `ros2 topic pub` does, each time in a fresh process of ROS 2 (rmw_fastrtps).

`ros_pub.py DOMAIN`: each order on standard input forks a process, before anything of DDS has begun.
Like the command it creates a node, spins for half a second, creates a publisher, waits for a
subscription (`-w 1`), publishes at a rate, and ends a tenth of a second later (ros2cli,
`ros2topic/verb/pub.py` and `ros2cli/node/direct.py`; no wheel has the command itself):

    {"do":"pub","topic":"/yahboomd/estop","rate":10,"times":50}     a std_msgs/Bool, true
    {"do":"pub","topic":"/yahboomd/odometry/set_pose","rate":10,"times":5,"x":2.0}
    {"do":"end"}                            Ctrl-C, unless it has ended

It prints `waits`, `published` with the time of the first message, and `ended`.

Now and then Fast DDS locks itself up in a fresh process, before it has a publisher: one thread has
the participants' lock and waits for the thread of the timers, which waits for that lock
(https://github.com/eProsima/Fast-DDS/issues/6502). A person ends the command and gives it again; so
does this, and prints `locked_up`.
"""

import json
import os
import select
import signal
import sys
import time
from contextlib import suppress
from typing import Any

os.environ["ROS_DOMAIN_ID"] = sys.argv[1]
# The wheels are no ROS installation: this names the folder that holds their resources.
os.environ["AMENT_PREFIX_PATH"] = sys.prefix

import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.executors import ExternalShutdownException
from rclpy.qos import QoSPresetProfiles
from std_msgs.msg import Bool

LOCKED_S = 20.0
"""A node and a publisher take a second, on a busy machine several."""


def say(**event: Any) -> None:
    print(json.dumps(event), flush=True)


def message(order: dict[str, Any]) -> Any:
    if "x" not in order:
        return Bool(data=True)
    pose = PoseWithCovarianceStamped()
    pose.header.frame_id = "odom"
    pose.pose.pose.position.x = order["x"]
    pose.pose.pose.orientation.w = 1.0
    return pose


def publish(order: dict[str, Any], found: int) -> None:
    """In the forked process: writes a byte to `found` once there is a publisher."""
    rclpy.init()
    node = rclpy.create_node(f"_ros2cli_{os.getpid()}", start_parameter_services=False)
    try:
        discovered_s = time.monotonic() + 0.5
        while (left_s := discovered_s - time.monotonic()) > 0:
            rclpy.spin_once(node, timeout_sec=left_s)
        wanted, qos = message(order), QoSPresetProfiles.DEFAULT.value
        publisher = node.create_publisher(type(wanted), order["topic"], qos)
        say(event="waits")
        os.write(found, b"+")
        while publisher.get_subscription_count() < 1:
            time.sleep(0.1)
        count = 0

        def again() -> None:
            nonlocal count
            count += 1
            publisher.publish(wanted)

        say(event="published", at_ns=time.time_ns())
        again()
        if order["times"] > 1:
            node.create_timer(1 / order["rate"], again)
        while count < order["times"]:
            rclpy.spin_once(node)
        time.sleep(0.1)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def start(order: dict[str, Any]) -> int:
    while True:
        reader, writer = os.pipe()
        child = os.fork()
        if not child:
            status = 1
            try:
                with suppress(KeyboardInterrupt, ExternalShutdownException):
                    publish(order, writer)
                status = 0
            finally:
                os._exit(status)
        os.close(writer)
        # Readable too if the process has ended.
        found, _, _ = select.select([reader], [], [], LOCKED_S)
        os.close(reader)
        if found:
            return child
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        say(event="locked_up")


def main() -> None:
    child = 0
    say(event="ready")
    for line in sys.stdin:
        order = json.loads(line)
        if order["do"] == "pub":
            child = start(order)
        else:
            os.kill(child, signal.SIGINT)
            _, status = os.waitpid(child, 0)
            say(event="ended", status=os.waitstatus_to_exitcode(status))


if __name__ == "__main__":
    main()
