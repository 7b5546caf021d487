"""What is around a robot in ROS 2: a lidar in a room, a pad, an onlooker. rclpy, by JSON lines.

`ros_world.py TOPIC=TYPE ...`: hears these topics (latched ones too) and prints each message as one
JSON line; of a map only what `map_of` keeps. It ends with its standard input:

    {"do":"publish","topic":"/joy","of":"sensor_msgs/msg/Joy","hz":20,"fields":{"axes":[0.0]}}
    {"do":"rest","topic":"/joy"}
    {"do":"activate","node":"slam_toolbox"}     configures and activates it, if it is a managed one
    {"do":"lidar","frame":"laser","x":0.1}      scans of ROOM from /odom, a sensor x m ahead of it
    {"do":"drive_to","robot":"bot1","x":1.5,"y":0.2}     by Nav2's planner, then by its controller
"""

import importlib
import json
import math
import os
import queue
import sys
import threading
import time
from collections import deque
from itertools import takewhile
from typing import Any

# The wheels are no ROS installation: this names the folder that holds their resources.
os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)

import rclpy
from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry, Path
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import LaserScan

ROOM = [
    *(
        (-1.5, -1.2, 2.5, -1.2),
        (2.5, -1.2, 2.5, 1.8),
        (2.5, 1.8, -1.5, 1.8),
        (-1.5, 1.8, -1.5, -1.2),
    ),
    *((1.4, 0.9, 1.9, 0.9), (1.9, 0.9, 1.9, 1.3), (1.9, 1.3, 1.4, 1.3), (1.4, 1.3, 1.4, 0.9)),
]
"""Walls, and a box that stands in the room: from where to where, in metres of the odometry."""
BEAMS = 360
RANGE_M = 12.0


def say(**line: Any) -> None:
    sys.stdout.write(json.dumps(line) + "\n")
    sys.stdout.flush()


def type_of(name: str) -> Any:
    package, kind, message = name.split("/")
    return getattr(importlib.import_module(f"{package}.{kind}"), message)


def plain(value: Any) -> Any:
    """A message as JSON has it."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):
        return value[0]
    if hasattr(value, "tolist"):
        return value.tolist()
    return [plain(each) for each in value] if isinstance(value, (list, tuple)) else value


def fill(message: Any, fields: dict[str, Any]) -> Any:
    for name, value in fields.items():
        if isinstance(value, dict):
            fill(getattr(message, name), value)
        else:
            setattr(message, name, value)
    return message


def map_of(message: Any) -> dict[str, Any]:
    """Its size, and a character for each cell: a wall, free or unknown."""
    cells = "".join("?" if c < 0 else "#" if c > 50 else "." for c in message.data)
    info = message.info
    rows = [cells[n : n + info.width] for n in range(0, len(cells), info.width)]
    at = [info.origin.position.x, info.origin.position.y]
    return {
        "frame_id": message.header.frame_id,
        "resolution": info.resolution,
        "at": at,
        "rows": rows,
    }


def distance_m(x: float, y: float, angle: float) -> float:
    """From a point along a ray to the nearest wall; RANGE_M if there is none."""
    dx, dy = math.cos(angle), math.sin(angle)
    nearest = RANGE_M
    for x0, y0, x1, y1 in ROOM:
        along = dx * (y1 - y0) - dy * (x1 - x0)
        if abs(along) < 1e-9:
            continue
        ray = ((x0 - x) * (y1 - y0) - (y0 - y) * (x1 - x0)) / along
        wall = ((x0 - x) * dy - (y0 - y) * dx) / along
        if ray > 0.0 and 0.0 <= wall <= 1.0:
            nearest = min(nearest, ray)
    return nearest


def straight(x0: float, y0: float, x: float, y: float) -> Path:
    """A way in the map, with a pose for each five centimetres."""
    steps = max(1, round(math.dist((x0, y0), (x, y)) / 0.05))
    path = fill(Path(), {"header": {"frame_id": "map"}})
    for n in range(steps + 1):
        at = {"x": x0 + (x - x0) * n / steps, "y": y0 + (y - y0) * n / steps}
        pose = {"position": at, "orientation": {"w": 1.0}}
        path.poses.append(fill(PoseStamped(header=path.header), {"pose": pose}))
    return path


class World:
    """Publishers and subscriptions of one node."""

    def __init__(self, topics: dict[str, str]) -> None:
        self.node = rclpy.create_node("world")
        self.timers: dict[str, Any] = {}
        self.publishers: dict[str, Any] = {}
        self.poses: deque[Odometry] = deque(maxlen=1)
        for topic, kind in topics.items():
            durability = DurabilityPolicy.VOLATILE
            if topic.endswith(("/tf_static", "/map", "/robot_description")):
                durability = DurabilityPolicy.TRANSIENT_LOCAL
            qos = QoSProfile(depth=100, durability=durability)
            self.node.create_subscription(type_of(kind), topic, self.hearing(topic), qos)

    @staticmethod
    def hearing(topic: str) -> Any:
        read = map_of if topic.endswith("/map") else plain
        return lambda message: say(event="message", topic=topic, message=read(message))

    def publish(self, topic: str, of: str, hz: float, fields: dict[str, Any]) -> None:
        kind = type_of(of)
        self.rest(topic)
        if topic not in self.publishers:
            self.publishers[topic] = self.node.create_publisher(kind, topic, 10)

        def due() -> None:
            message = fill(kind(), fields)
            if hasattr(message, "header"):
                message.header.stamp = self.node.get_clock().now().to_msg()
            self.publishers[topic].publish(message)

        self.timers[topic] = self.node.create_timer(1.0 / hz, due)

    def rest(self, topic: str) -> None:
        if timer := self.timers.pop(topic, None):
            self.node.destroy_timer(timer)

    def activate(self, node: str, patience_s: float = 10.0) -> None:
        from lifecycle_msgs.srv import ChangeState

        client = self.node.create_client(ChangeState, f"/{node}/change_state")
        if not client.wait_for_service(patience_s):
            say(event="unmanaged", node=node)
            return
        for step in (1, 3):
            request = ChangeState.Request()
            request.transition.id = step
            if not self.end_of(client.call_async(request)).success:
                say(event="refused", node=node, step=step)
                return
        say(event="active", node=node)

    def end_of(self, asked: Any) -> Any:
        rclpy.spin_until_future_complete(self.node, asked)
        return asked.result()

    def act(self, name: str, kind: Any, goal: Any) -> tuple[int, Any]:
        """How an action ended, and what came of it. A server refuses until it is active."""
        from rclpy.action import ActionClient

        client = ActionClient(self.node, kind, name)
        client.wait_for_server()
        while not (handle := self.end_of(client.send_goal_async(goal))).accepted:
            rclpy.spin_once(self.node, timeout_sec=0.2)
        answer = self.end_of(handle.get_result_async())
        client.destroy()
        return answer.status, answer.result

    def drive_to(self, robot: str, x: float, y: float, start: list[float] | None = None) -> None:
        """As Nav2's navigator does: one that gives up is asked again after a rest, six times.

        Without a planner the way is straight, from a start.
        """
        from nav2_msgs.action import ComputePathToPose, FollowPath

        place = fill(ComputePathToPose.Goal(), {"goal": {"header": {"frame_id": "map"}}})
        fill(place.goal.pose, {"position": {"x": x, "y": y}, "orientation": {"w": 1.0}})
        planned = ComputePathToPose.Result()
        if start is not None:
            planned.path = straight(*start, x, y)
        # By the names that Nav2's own file gives them.
        named = {"controller_id": "FollowPath", "goal_checker_id": "general_goal_checker"}
        errors: list[int] = []
        status = GoalStatus.STATUS_UNKNOWN
        while status != GoalStatus.STATUS_SUCCEEDED and len(errors) < 7:
            if errors:
                self.rest_s(5.0)
            if start is None:
                of = f"/{robot}/compute_path_to_pose"
                status, planned = self.act(of, ComputePathToPose, place)
                if status != GoalStatus.STATUS_SUCCEEDED:
                    errors.append(planned.error_code)
                    continue
            way = fill(FollowPath.Goal(path=planned.path), named)
            status, followed = self.act(f"/{robot}/follow_path", FollowPath, way)
            if status != GoalStatus.STATUS_SUCCEEDED:
                errors.append(followed.error_code)
        places = [each.pose.position for each in planned.path.poses]
        path = [(each.x, each.y) for each in places]
        say(event="arrived", status=status, errors=errors, path=path)

    def rest_s(self, duration_s: float) -> None:
        """Its recovery that waits: transforms that were late arrive."""
        ends = time.monotonic() + duration_s
        while (left_s := ends - time.monotonic()) > 0.0:
            rclpy.spin_once(self.node, timeout_sec=left_s)

    def note_pose(self, odom: Odometry) -> None:
        self.poses.append(odom)

    def lidar(self, frame: str, x: float) -> None:
        scans = self.node.create_publisher(LaserScan, "/scan", 10)
        self.node.create_subscription(Odometry, "/odom", self.note_pose, 10)

        def due() -> None:
            if not self.poses:
                return
            odom = self.poses.pop()
            at, turn = odom.pose.pose.position, odom.pose.pose.orientation
            heading = 2.0 * math.atan2(turn.z, turn.w)
            here = (at.x + x * math.cos(heading), at.y + x * math.sin(heading))
            scan = LaserScan(angle_min=-math.pi, range_min=0.05, range_max=RANGE_M)
            scan.header.stamp, scan.header.frame_id = odom.header.stamp, frame
            scan.angle_increment = 2.0 * math.pi / BEAMS
            scan.angle_max = scan.angle_min + (BEAMS - 1) * scan.angle_increment
            angles = (heading + scan.angle_min + n * scan.angle_increment for n in range(BEAMS))
            scan.ranges = [distance_m(*here, angle) for angle in angles]
            scans.publish(scan)

        self.timers["/scan"] = self.node.create_timer(0.2, due)


def main() -> None:
    orders: queue.Queue[dict[str, Any] | None] = queue.Queue()

    def listen() -> None:
        for line in sys.stdin:
            orders.put(json.loads(line))
        orders.put(None)

    rclpy.init()
    topics = takewhile("--ros-args".__ne__, sys.argv[1:])
    world = World(dict(each.split("=") for each in topics))
    threading.Thread(target=listen, daemon=True).start()
    say(event="ready", middleware=rclpy.get_rmw_implementation_identifier())
    while True:
        rclpy.spin_once(world.node, timeout_sec=0.01)
        try:
            order = orders.get_nowait()
        except queue.Empty:
            continue
        if order is None:
            break
        getattr(world, order.pop("do"))(**order)
    world.node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
