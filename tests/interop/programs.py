"""ROS 2's own compiled programs against a simulated robot: `make ros-programs`, in a sourced ROS 2.

Each is taken from the installation (AMENT_PREFIX_PATH); one that is not installed is skipped by
name. With RMW_IMPLEMENTATION=rmw_zenoh_cpp the robot is the router of their graph, else the bridge
of `make interop` stands between. Each test prints a row of the table in docs/bringup.md.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from real_robot import Client, RealRobot, wait_for
from ros_peers import HERE, Bridge, Peer, start_peer

pytestmark = pytest.mark.realtime

NATIVE = os.environ.get("RMW_IMPLEMENTATION") == "rmw_zenoh_cpp"
WAY = "natively" if NATIVE else "bridge"
PYTHON = os.environ.get("YAHBOOMD_RMW_ZENOH_PYTHON") or "python3"
PREFIXES = [Path(each) for each in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)]
LASER = 'ros2.static_transforms=[{parent="base_link",child="laser",x=0.1}]'
ROOM_M = (4.0, 3.0)
"""The size of the room in ros_world.py."""


def installed(package: str, part: str) -> Path:
    """A file of an installed package, or a skip that names the package."""
    found = (each / part for each in PREFIXES if (each / "share" / package).is_dir())
    path = next(filter(Path.exists, found), None)
    if path is None:
        pytest.skip(f"{package} is not installed: no {part} in AMENT_PREFIX_PATH")
    return path


def version(package: str) -> str:
    text = installed(package, f"share/{package}/package.xml").read_text()
    found = re.search(r"<version>\s*([^<\s]+)", text)
    assert found
    return found[1]


@dataclass
class Graph:
    """A robot and the nodes around it, on one middleware."""

    folder: Path
    stack: ExitStack
    bridge: Bridge | None
    settings: list[str] = field(default_factory=list)
    environment: dict[str, str] = field(default_factory=dict)

    def robot(self, *settings: str) -> RealRobot:
        way = ["ros2.rmw_zenoh=true", "ros2.bridge=false"]
        if self.bridge is not None:
            way = [f'zenoh.connect=["{self.bridge.endpoint}"]']
        self.settings = [part for each in (LASER, *settings, *way) for part in ("--set", each)]
        robot = RealRobot(self.folder, run=self.settings)
        self.stack.callback(robot.close)
        robot.daemon.says("Connected")
        self.environment = {"ROS_DOMAIN_ID": "0"}
        if self.bridge is not None:
            self.environment = {"ROS_DOMAIN_ID": str(self.bridge.domain)}
        else:
            override = f'connect/endpoints=["{robot.endpoint}"]'
            self.environment["ZENOH_CONFIG_OVERRIDE"] = override
        return robot

    def config(self, *words: str) -> str:
        """What `yahboomd config` prints of this robot."""
        asked = [sys.executable, "-m", "yahboomd", "config", *words, *self.settings]
        return subprocess.run(asked, check=True, capture_output=True, text=True).stdout

    def parameters(self, package: str) -> str:
        """The file that `yahboomd config parameters` prints."""
        path = self.folder / f"{package}.params.yaml"
        path.write_text(self.config("parameters", package))
        return str(path)

    def start(
        self, package: str, program: str, *remaps: str, files: Sequence[str] = (), **more: Any
    ) -> None:
        """A node, until the test ends.

        Args:
            package: Its package.
            program: Its program.
            remaps: Of names.
            files: Of parameters.
            more: Parameters that are in no file.
        """
        if more:
            path = self.folder / f"{program}.yaml"
            # JSON is YAML as well.
            path.write_text(json.dumps({"/**": {"ros__parameters": more}}))
            files = (*files, str(path))
        command = [str(installed(package, f"lib/{package}/{program}")), "--ros-args"]
        command += [part for each in remaps for part in ("-r", each)]
        command += [part for each in files for part in ("--params-file", each)]
        log = self.stack.enter_context((self.folder / f"{program}.log").open("w"))
        process = subprocess.Popen(
            command, env={**os.environ, **self.environment}, stdout=log, stderr=log
        )
        self.stack.callback(self.ended, process)

    def ended(self, process: subprocess.Popen[bytes]) -> None:
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        for log in self.folder.glob("*.log"):
            print(log.name, log.read_text()[-3000:])

    def world(self, **topics: str) -> Peer:
        """What is around the robot; it hears these topics, whose names lack their first slash."""
        heard = [f"/{topic.replace('__', '/')}={kind}" for topic, kind in topics.items()]
        settings = [f"{name}={value}" for name, value in self.environment.items()]
        command = ["env", *settings, PYTHON, str(HERE / "ros_world.py"), *heard]
        peer = start_peer(command, self.folder / "world.log")
        self.stack.callback(peer.close)
        return peer


@pytest.fixture
def graph(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Graph]:
    bridge = None if NATIVE else request.getfixturevalue("ros_bridge")
    with ExitStack() as stack:
        yield Graph(tmp_path, stack, bridge)


@pytest.fixture
def onlooker(graph: Graph, client: Callable[..., Client]) -> Callable[[RealRobot], Client]:
    def join(robot: RealRobot) -> Client:
        found = client("client", robot.endpoint)
        found.in_state("standing")
        return found

    return join


@pytest.fixture
def row(capsys: pytest.CaptureFixture[str]) -> Callable[[str, str], None]:
    """Prints what was seen of a package, as docs/bringup.md has it."""

    def tell(package: str, seen: str) -> None:
        with capsys.disabled():
            print(f"\n| {package} | {version(package)} | {WAY} | {seen} |")

    return tell


def command(world: Peer, topic: str, vx: float, wz: float = 0.0) -> None:
    """A Twist, twenty times a second."""
    fields = {"linear": {"x": vx}, "angular": {"z": wz}}
    world.order("publish", topic=topic, of="geometry_msgs/msg/Twist", hz=20, fields=fields)


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


def extent_m(drawn: dict[str, Any]) -> tuple[float, float]:
    """From the first to the last wall of a map, across and along."""
    walls = [
        (x, y) for y, line in enumerate(drawn["rows"]) for x, cell in enumerate(line) if cell == "#"
    ]
    if not walls:
        return 0.0, 0.0
    across, along = zip(*walls, strict=True)
    step = float(drawn["resolution"])
    return (max(across) - min(across)) * step, (max(along) - min(along)) * step


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
