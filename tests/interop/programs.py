"""ROS 2's own compiled programs against a simulated robot: `make ros-programs`, in a sourced ROS 2.

Each is taken from the installation (AMENT_PREFIX_PATH); one that is not installed is skipped by
name. With RMW_IMPLEMENTATION=rmw_zenoh_cpp the robot is the router of their graph, else the bridge
of `make interop` stands between. Each test prints a row of the table in docs/bringup.md.
"""

from __future__ import annotations

import json
import math
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
from ros_peers import HERE, Bridge, Peer, built, example_for, start_peer

pytestmark = pytest.mark.realtime

NATIVE = os.environ.get("RMW_IMPLEMENTATION") == "rmw_zenoh_cpp"
WAY = "natively" if NATIVE else "bridge"
PYTHON = os.environ.get("YAHBOOMD_RMW_ZENOH_PYTHON") or "python3"
PREFIXES = [Path(each) for each in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)]
LASER = 'ros2.static_transforms=[{parent="base_link",child="laser",x=0.1}]'
FAR = "10000000,0,10000000,0"
"""Counters far from those after a reset, so that a delayed board loses no way."""
ROOM_M = (4.0, 3.0)
"""The size of the room in ros_world.py."""
BRINGUP = HERE.parents[1] / "ros2" / "yahboomd_bringup"
NAV2 = {
    "nav2_controller": "controller_server",
    "nav2_velocity_smoother": "velocity_smoother",
    "nav2_planner": "planner_server",
    "nav2_collision_monitor": "collision_monitor",
}
"""What Nav2 needs to reach a place; without the last two its paths are straight and unguarded."""
MORE_OF_NAV2 = {
    "nav2_behaviors": "behavior_server",
    "nav2_bt_navigator": "bt_navigator",
    "nav2_route": "route_server",
    "nav2_smoother": "smoother_server",
    "nav2_waypoint_follower": "waypoint_follower",
    "opennav_docking": "opennav_docking",
    "nav2_lifecycle_manager": "lifecycle_manager",
}
"""What its launch file starts besides; the last one manages all others."""
CONTROLLERS = ("nav2_mppi_controller", "nav2_regulated_pure_pursuit_controller")
"""The one of Nav2's own file, and one that is taken if that is not installed."""
SUCCEEDED = 4


def found(package: str, part: str) -> Path | None:
    """A file of an installed package."""
    parts = (each / part for each in PREFIXES if (each / "share" / package).is_dir())
    return next(filter(Path.exists, parts), None)


def installed(package: str, part: str) -> Path:
    """A file of an installed package, or a skip that names the package."""
    path = found(package, part)
    if path is None:
        pytest.skip(f"{package} is not installed: no {part} in AMENT_PREFIX_PATH")
    return path


def version(package: str) -> str:
    text = installed(package, f"share/{package}/package.xml").read_text()
    written = re.search(r"<version>\s*([^<\s]+)", text)
    assert written
    return written[1]


@dataclass
class Graph:
    """A robot and the nodes around it, on one middleware."""

    folder: Path
    stack: ExitStack
    bridge: Bridge | None
    settings: list[str] = field(default_factory=list)
    environment: dict[str, str] = field(default_factory=dict)

    def robot(self, *settings: str, router: str = "") -> RealRobot:
        """The robot.

        Args:
            settings: More of its settings.
            router: The endpoint of the robot that is the router, if this one is not.
        """
        way = ["ros2.rmw_zenoh=true", "ros2.bridge=false"]
        way += [f'zenoh.connect=["{router}"]'] if router else []
        if self.bridge is not None:
            way = [f'zenoh.connect=["{self.bridge.endpoint}"]']
        self.settings = [part for each in (LASER, *settings, *way) for part in ("--set", each)]
        robot = RealRobot(self.folder, simulate=("--ticks", FAR), run=self.settings)
        self.stack.callback(robot.close)
        robot.daemon.says("Connected")
        self.environment = {"ROS_DOMAIN_ID": "0"}
        if self.bridge is not None:
            self.environment = {"ROS_DOMAIN_ID": str(self.bridge.domain)}
        else:
            override = f'connect/endpoints=["{router or robot.endpoint}"]'
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

    def launch(self, *arguments: str, config: Path, environment: dict[str, str]) -> None:
        """The bring-up of a robot, by ROS 2's own `launch`, until the test ends."""
        yahboomd = Path(sys.executable).with_name("yahboomd")
        file = BRINGUP / "launch/bringup.launch.py"
        given = [f"config:={config}", f"yahboomd:={yahboomd}", "way:=none", *arguments]
        peer = start_peer(
            [PYTHON, str(HERE / "launched.py"), str(file), *given],
            self.folder / "launch.log",
            {**environment, **self.environment},
        )
        # `launch` ends all of its nodes before itself.
        self.stack.callback(peer.close, 60.0)

    def world(self, namespace: str = "", **topics: str) -> Peer:
        """What is around the robot; it hears these topics, whose names lack their first slash."""
        heard = [f"/{topic.replace('__', '/')}={kind}" for topic, kind in topics.items()]
        settings = [f"{name}={value}" for name, value in self.environment.items()]
        command = ["env", *settings, PYTHON, str(HERE / "ros_world.py"), *heard]
        if namespace:
            remaps = (f"{name}:=/{namespace}{name}" for name in ("/odom", "/scan"))
            command += ["--ros-args", *(part for each in remaps for part in ("-r", each))]
        number = len(list(self.folder.glob("world*.log")))
        peer = start_peer(command, self.folder / f"world{number}.log")
        self.stack.callback(peer.close)
        return peer


@pytest.fixture
def graph(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Graph]:
    bridge = None if NATIVE else request.getfixturevalue("ros_bridge")
    with ExitStack() as stack:
        yield Graph(tmp_path, stack, bridge)


@pytest.fixture
def graphs(tmp_path: Path) -> Iterator[dict[str, Graph]]:
    """Of two robots, by name; what is heard of them, is in one graph."""
    with ExitStack() as stack:
        bridge = None
        if not NATIVE:
            config = example_for("bot.", tmp_path / "bridge.json5")
            log = tmp_path / "bridge.log"
            bridge = Bridge(built("bridge"), log, config=config, discovery="SUBNET")
            stack.callback(bridge.stop)
            bridge.start()
        folders = {name: tmp_path / name for name in ("bot1", "bot2")}
        for folder in folders.values():
            folder.mkdir()
        yield {name: Graph(folder, stack, bridge) for name, folder in folders.items()}


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


@pytest.fixture
def prefix(tmp_path: Path) -> Path:
    """Of the bring-up, and sleepers in place of those of Nav2's programs that are not installed.

    The manager waits for each one, so it sleeps if another one does.
    """
    shared = tmp_path / "prefix/share"
    index = shared / "ament_index/resource_index/packages"
    index.mkdir(parents=True)
    missing = {
        n: p for n, p in {**NAV2, **MORE_OF_NAV2}.items() if found(n, f"lib/{n}/{p}") is None
    }
    if missing:
        missing["nav2_lifecycle_manager"] = MORE_OF_NAV2["nav2_lifecycle_manager"]
    for package, program in missing.items():
        sleeper = tmp_path / "prefix/lib" / package / program
        sleeper.parent.mkdir(parents=True)
        sleeper.write_text("#!/bin/sh\nexec sleep 3600\n")
        sleeper.chmod(0o755)
        (shared / package).mkdir()
        (index / package).touch()
    (shared / "yahboomd_bringup").symlink_to(BRINGUP)
    (index / "yahboomd_bringup").touch()
    return shared.parent


def bring_up(
    graphs: dict[str, Graph], prefix: Path, given: Sequence[str], *settings: str
) -> dict[str, RealRobot]:
    """Two robots, each with a lidar in a room, and its own bring-up."""
    installed("slam_toolbox", "lib/slam_toolbox/async_slam_toolbox_node")
    paths = (str(BRINGUP), os.environ.get("PYTHONPATH", ""))
    environment = {
        **os.environ,
        "AMENT_PREFIX_PATH": f"{prefix}:{os.environ['AMENT_PREFIX_PATH']}",
        "PYTHONPATH": ":".join(filter(None, paths)),
    }
    router, robots = "", {}
    for name, graph in graphs.items():
        robots[name] = graph.robot(f"zenoh.namespace={name}", *settings, router=router)
        if NATIVE:
            router = router or robots[name].endpoint
        config = graph.folder / "config.toml"
        config.write_text(f'zenoh.namespace = "{name}"\n{LASER}\n')
        lidar = graph.world(name)
        lidar.order("lidar", frame="laser", x=0.1)
        graph.launch("slam:=true", *given, config=config, environment=environment)
    return robots


def test_slam_toolbox_maps_for_one_of_two_robots(
    graphs: dict[str, Graph], prefix: Path, row: Callable[[str, str], None]
) -> None:
    robots = bring_up(graphs, prefix, [])
    maps = {f"{name}__map": "nav_msgs/msg/OccupancyGrid" for name in graphs}
    world = graphs["bot1"].world(**maps, bot2__tf="tf2_msgs/msg/TFMessage")
    # The other one has a map as well, of what it sees from where it stands.
    first = world.await_event(lambda e: e.get("topic") == "/bot2/map", "its map", 240.0)
    assert first["message"]["frame_id"] == "map"
    command(world, "/bot1/cmd_vel", 0.15, 0.3)
    wait_for(lambda: robots["bot1"].travelled_m() > 6.0, "the robot to drive around", 240.0)

    def whole() -> bool:
        found_m = extent_m(world.message("/bot1/map"))
        return all(abs(each - real) < 0.15 for each, real in zip(found_m, ROOM_M, strict=True))

    wait_for(whole, "a map of the room's size", 240.0)
    world.events.clear()
    for frame in ("odom", "base_link"):
        (at,) = world.message("/bot2/tf", lambda m, f=frame: child(m) == f)["transforms"]
        place = at["transform"]["translation"]
        assert math.hypot(place["x"], place["y"]) < 0.1
    world.order("rest", topic="/bot1/cmd_vel")
    robots["bot1"].settled_truth()
    assert robots["bot2"].travelled_m() == 0.0
    row(
        "slam_toolbox",
        "with the launch files of two robots in one graph: a map of the room for the one that "
        "drives, and the other one stays where it stands",
    )


def child(transforms: dict[str, Any]) -> str:
    return str(transforms["transforms"][0]["child_frame_id"])


def test_nav2_drives_two_robots(
    graphs: dict[str, Graph], prefix: Path, row: Callable[[str, str], None]
) -> None:
    """Each has its own bring-up with slam_toolbox, in the launch files of the packages."""
    installed("nav2_bringup", "share/nav2_bringup/package.xml")
    nodes = [each for each in NAV2 if not (prefix / "lib" / each).exists()]
    for package in list(NAV2)[:2]:
        installed(package, f"lib/{package}/{NAV2[package]}")
    given = ["navigation:=true", "robot_radius:=0.15"]
    first, other = CONTROLLERS
    controller = first if found(first, f"share/{first}/package.xml") else other
    if controller == other:
        plugin = f"{other}::RegulatedPurePursuitController"
        mine = {"controller_server": {"ros__parameters": {"FollowPath": {"plugin": plugin}}}}
        (prefix / "mine.yaml").write_text(json.dumps(mine))
        given.append(f"nav2_params:={prefix / 'mine.yaml'}")
    settings = []
    if "nav2_collision_monitor" not in nodes:
        settings.append("command.sources.cmd_vel_smoothed.priority=10")
    robots = bring_up(graphs, prefix, given, *settings)
    operator = graphs["bot1"].world()
    if (prefix / "lib/nav2_lifecycle_manager").exists():
        for node in [f"{name}/{NAV2[each]}" for name in robots for each in nodes]:
            operator.order("activate", node=node)
            operator.await_event(lambda e, n=node: e == {"event": "active", "node": n}, node, 120.0)
    ended_m = []
    for name, x, y in (("bot1", 1.5, 0.2), ("bot2", -0.9, 0.9), ("bot1", 0.0, 1.0)):
        (stands,) = (robots[each] for each in robots if each != name)
        before_m = stands.travelled_m()
        truth = robots[name].settled_truth()
        start = None if "nav2_planner" in nodes else [truth.x, truth.y]
        operator.order("drive_to", robot=name, x=x, y=y, start=start)
        ended = operator.await_event(lambda e: e["event"] == "arrived", "the end", 240.0)
        assert ended["status"] == SUCCEEDED, ended
        assert math.dist(ended["path"][-1], (x, y)) < 0.1
        print(name, "gave up with", ended["errors"])
        truth = robots[name].settled_truth()
        ended_m.append(math.dist((truth.x, truth.y), (x, y)))
        # The goal checker's tolerance, and what the map is off.
        assert ended_m[-1] < 0.35
        assert stands.travelled_m() == before_m
    for package in (*nodes, controller):
        row(
            package,
            "with the launch files and generated parameters of two robots in one graph: each is "
            f"driven on {'planned' if 'nav2_planner' in nodes else 'straight'} paths, to "
            + ", ".join(f"{1000.0 * each:.0f} mm" for each in ended_m)
            + " from its goals, while the other one stands",
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
