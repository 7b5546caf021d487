"""ROS 2's own compiled programs against a simulated robot: `make ros-programs`, in a sourced ROS 2.

Each is taken from the installation (AMENT_PREFIX_PATH); one that is not installed is skipped by
name. With RMW_IMPLEMENTATION=rmw_zenoh_cpp the robot is the router of their graph, else the bridge
of `make interop` stands between. Each test prints a row of the table in docs/bringup.md.
"""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable
from typing import Any

import pytest
from real_robot import Client, RealRobot, wait_for
from ros_graph import NATIVE, PYTHON, ROOM_M, Graph, command, extent_m, installed, python
from ros_peers import Peer

pytestmark = pytest.mark.realtime


@pytest.fixture
def onlooker(graph: Graph, client: Callable[..., Client]) -> Callable[[RealRobot], Client]:
    def join(robot: RealRobot) -> Client:
        found = client("client", robot.endpoint)
        found.in_state("standing")
        return found

    return join


def speed(odom: dict[str, Any]) -> float:
    return float(odom["twist"]["twist"]["linear"]["x"])


def turned(peer: Peer, child: str) -> float:
    """How far a wheel's transform is turned: the next one with this child."""

    def of(message: dict[str, Any]) -> list[float]:
        return [
            abs(each["transform"]["rotation"]["w"])
            for each in message["transforms"]
            if each["child_frame_id"] == child
        ]

    return of(peer.message("/tf", lambda m: bool(of(m)), f"the transform of {child}"))[0]


def test_robot_state_publisher(graph: Graph, row: Callable[[str, str], None]) -> None:
    robot = graph.robot()
    graph.start(
        "robot_state_publisher", "robot_state_publisher", robot_description=graph.config("urdf")
    )
    world = graph.world(tf="tf2_msgs/msg/TFMessage", robot_description="std_msgs/msg/String")
    assert world.message("/robot_description")["data"].startswith("<?xml")
    at_rest = turned(world, "left_wheel")
    command(world, "/cmd_vel", 0.2)
    wait_for(lambda: abs(turned(world, "left_wheel") - at_rest) > 0.2, "the wheel to turn")
    world.order("rest", topic="/cmd_vel")
    robot.settled_truth()
    row(
        "robot_state_publisher",
        "takes the model of `config urdf`; its transform of `left_wheel` turns as the robot drives",
    )


def test_teleop_twist_joy(
    graph: Graph,
    onlooker: Callable[[RealRobot], Client],
    row: Callable[[str, str], None],
) -> None:
    robot = graph.robot()
    file = graph.parameters("joystick")
    remaps = ("__node:=teleop_twist_joy_node", "cmd_vel:=cmd_vel/teleop")
    graph.start("teleop_twist_joy", "teleop_node", *remaps, files=[file])
    world, status = graph.world(), onlooker(robot)

    def pad(held: int) -> None:
        # The button and the stick of the file.
        fields = {"axes": [0.0, 1.0, 0.0, 0.0], "buttons": [0, 0, 0, 0, held, 0]}
        world.order("publish", topic="/joy", of="sensor_msgs/msg/Joy", hz=20, fields=fields)

    pad(0)
    pad(1)
    assert status.in_state("driving")["driver"] == "cmd_vel/teleop"
    pad(0)
    status.in_state("standing")
    robot.settled_truth()
    row(
        "teleop_twist_joy",
        "with the parameters of `config parameters joystick` it drives while the button is held; "
        "the robot stands once it is released, with the stick still pushed",
    )


def test_ros2cli(
    graph: Graph,
    onlooker: Callable[[RealRobot], Client],
    row: Callable[[str, str], None],
) -> None:
    robot = graph.robot()
    status = onlooker(robot)
    alone = "--no-daemon"
    wait_for(lambda: "/odom" in graph.ros2("topic", "list", alone).split(), "its topics")
    assert "Type: nav_msgs/msg/Odometry" in graph.ros2("topic", "info", alone, "/odom")
    echoed = graph.ros2("topic", "echo", "--once", "/odom", "nav_msgs/msg/Odometry")
    assert "child_frame_id: base_link" in echoed
    press = ("-w", "1", "--once", "/yahboomd/estop", "std_msgs/msg/Bool", "{data: true}")
    graph.ros2("topic", "pub", *press)
    status.in_state("estopped")
    seen = "`topic list`, `info`, `echo` and `pub` (the e-stop)"
    if NATIVE:
        assert "/yahboomd" in graph.ros2("node", "list", alone).split()
        called = graph.ros2("service", "call", "/e_stop_reset", "std_srvs/srv/Trigger")
        assert "success=True" in called
        status.in_state("standing")
        assert "command.timeout_s" in graph.ros2("param", "list", alone, "/yahboomd")
        value = graph.ros2("param", "get", alone, "/yahboomd", "command.timeout_s")
        assert "Double value is: 0.5" in value
        seen += "; `node list`, `service call /e_stop_reset`, `param list` and `get`"
    row("ros2cli", seen)


def test_teleop_twist_keyboard(
    graph: Graph,
    onlooker: Callable[[RealRobot], Client],
    row: Callable[[str, str], None],
) -> None:
    python("import teleop_twist_keyboard")
    robot = graph.robot()
    status = onlooker(robot)
    run = "from teleop_twist_keyboard import main; main()"
    keyboard, terminal = os.openpty()
    with open(graph.folder / "keys.log", "w") as log:
        process = subprocess.Popen(
            [PYTHON, "-c", run, "--ros-args", "-r", "cmd_vel:=cmd_vel/teleop"],
            env={**os.environ, **graph.environment},
            stdin=terminal,
            stdout=log,
            stderr=log,
        )
    graph.stack.callback(graph.ended, process)
    os.close(terminal)
    graph.stack.callback(os.close, keyboard)

    def driven() -> bool:
        os.write(keyboard, b"i")
        newest = status.latest("status")
        return newest["state"] == "driving" and newest["driver"] == "cmd_vel/teleop"

    wait_for(driven, "the held key to drive")
    status.in_state("standing")
    assert robot.settled_truth().x > 0.0
    row(
        "teleop_twist_keyboard",
        "with `-r cmd_vel:=cmd_vel/teleop` the held key drives, and the robot stands once it is "
        "released",
    )


def test_twist_mux(
    graph: Graph,
    onlooker: Callable[[RealRobot], Client],
    row: Callable[[str, str], None],
) -> None:
    robot = graph.robot()
    sources = {
        "navigation": {"topic": "nav_vel", "timeout": 0.5, "priority": 10},
        "joystick": {"topic": "joy_vel", "timeout": 0.5, "priority": 100},
    }
    settings = {"use_stamped": False, "topics": sources}
    graph.start("twist_mux", "twist_mux", "cmd_vel_out:=cmd_vel", **settings)
    world, status = graph.world(odom="nav_msgs/msg/Odometry"), onlooker(robot)

    def drives_at(wanted: float) -> None:
        world.message("/odom", lambda m: abs(speed(m) - wanted) < 0.02, f"{wanted} m/s")

    command(world, "/nav_vel", 0.2)
    drives_at(0.2)
    command(world, "/joy_vel", -0.1)
    drives_at(-0.1)
    world.order("rest", topic="/joy_vel")
    drives_at(0.2)
    world.order("rest", topic="/nav_vel")
    status.in_state("standing")
    robot.settled_truth()
    row(
        "twist_mux",
        "of two sources on `cmd_vel` the robot follows that of the greater priority, then the "
        "other; it stands once both are silent",
    )


def test_robot_localization(graph: Graph, row: Callable[[str, str], None]) -> None:
    robot = graph.robot("ros2.publish_tf=false")
    file = graph.parameters("robot_localization")
    graph.start("robot_localization", "ekf_node", files=[file])
    kinds = {"odom": "nav_msgs/msg/Odometry", "odometry__filtered": "nav_msgs/msg/Odometry"}
    world = graph.world(**kinds, tf="tf2_msgs/msg/TFMessage")
    world.message("/odometry/filtered")
    command(world, "/cmd_vel", 0.2, 0.3)
    wait_for(lambda: robot.travelled_m() > 2.0, "the robot to drive two metres with its wheels")
    world.order("rest", topic="/cmd_vel")
    robot.settled_truth()
    world.events.clear()

    def place(topic: str) -> tuple[float, float]:
        at = world.message(topic)["pose"]["pose"]["position"]
        return at["x"], at["y"]

    apart_m = max(
        abs(one - two) for one, two in zip(place("/odom"), place("/odometry/filtered"), strict=True)
    )
    assert apart_m < 0.05
    (transform,) = world.message("/tf")["transforms"]
    assert (transform["header"]["frame_id"], transform["child_frame_id"]) == ("odom", "base_link")
    row(
        "robot_localization",
        f"the EKF publishes `odom` to `base_link`; after a metre in a curve its pose is "
        f"{1000.0 * apart_m:.0f} mm from yahboomd's",
    )


def test_nav2_velocity_smoother(
    graph: Graph,
    onlooker: Callable[[RealRobot], Client],
    row: Callable[[str, str], None],
) -> None:
    robot = graph.robot()
    file = graph.parameters("nav2")
    remaps = ("cmd_vel:=nav_vel", "cmd_vel_smoothed:=cmd_vel")
    graph.start("nav2_velocity_smoother", "velocity_smoother", *remaps, files=[file])
    world, status = graph.world(odom="nav_msgs/msg/Odometry"), onlooker(robot)
    world.order("activate", node="velocity_smoother")
    world.await_event(lambda e: e["event"] == "active", "an active smoother")
    command(world, "/nav_vel", 2.0)
    world.message("/odom", lambda m: speed(m) > 0.4, "the robot to drive")
    highest = max(speed(world.message("/odom")) for _ in range(50))
    world.order("rest", topic="/nav_vel")
    status.in_state("standing")
    robot.settled_truth()
    assert highest == pytest.approx(0.5, abs=0.05)
    row(
        "nav2_velocity_smoother",
        f"with `config parameters nav2` it is configured and activated; a command of 2 m/s drives "
        f"the robot at {highest:.2f} m/s, and it stands once the commands end",
    )


def picture(rows: list[str]) -> str:
    """A map with a character for four by two of its cells, as it is seen from above."""
    blocks = [
        ["".join(row[x : x + 2] for row in rows[y : y + 4]) for x in range(0, len(rows[0]), 2)]
        for y in range(0, len(rows), 4)
    ]
    return "\n".join(
        "".join(next(sign for sign in "#.?" if sign in cells) for cells in line)
        for line in reversed(blocks)
    )


def test_slam_toolbox(
    graph: Graph, row: Callable[[str, str], None], capsys: pytest.CaptureFixture[str]
) -> None:
    robot = graph.robot()
    own = installed("slam_toolbox", "share/slam_toolbox/config/mapper_params_online_async.yaml")
    files = (str(own), graph.parameters("slam_toolbox"))
    graph.start(
        "slam_toolbox",
        "async_slam_toolbox_node",
        files=files,
        use_sim_time=False,
    )
    world = graph.world(map="nav_msgs/msg/OccupancyGrid")
    world.order("lidar", frame="laser", x=0.1)
    # From 2.8 on it is managed.
    world.order("activate", node="slam_toolbox")
    command(world, "/cmd_vel", 0.15, 0.3)
    drawn = world.message("/map")

    def whole() -> bool:
        nonlocal drawn
        drawn = world.message("/map", what="a map")
        return all(
            abs(found - real) < 0.15 for found, real in zip(extent_m(drawn), ROOM_M, strict=True)
        )

    wait_for(lambda: robot.travelled_m() > 6.0, "the robot to drive around")
    wait_for(whole, "a map of the room's size")
    world.order("rest", topic="/cmd_vel")
    robot.settled_truth()
    across_m, along_m = extent_m(drawn)
    row(
        "slam_toolbox",
        f"a map from the scans of a simulated lidar, {across_m:.2f} m by {along_m:.2f} m between "
        f"the outer walls of a room of {ROOM_M[0]} m by {ROOM_M[1]} m",
    )
    with capsys.disabled():
        print(picture(drawn["rows"]))
