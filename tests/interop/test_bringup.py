"""The bring-up package: built by colcon, launched by ROS 2's own `launch` if it is available.

`launch` is not among the wheels. If `python3` of the environment has it (a sourced ROS
installation), or the interpreter that YAHBOOMD_LAUNCH_PYTHON names, the launch files are launched.
Stand-ins that read their parameters by ROS 2's own reader are started in place of the nodes.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import pytest
from real_robot import RealRobot, wait_for
from ros_peers import CACHE, Bridge, Event, Peer, built, example_for, free_domain, start_peer

from yahboomd.core.config import Config
from yahboomd.tools.ros_files.robot_model import urdf

pytestmark = [pytest.mark.realtime, pytest.mark.nightly]

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "extras/ros2/yahboomd_bringup"
LAUNCHED = Path(__file__).with_name("launched.py")
STAND_IN = LAUNCHED.with_name("stand_in.py")
YAHBOOMD = str(Path(sys.executable).with_name("yahboomd"))
FRAMES = [{"parent": "base_link", "child": "laser", "x": 0.1, "z": 0.2, "yaw": 3.1}]
MODELS = {
    "2wd": {},
    "4wd": {"chassis": {"preset": "4wd"}, "ros2": {"static_transforms": FRAMES}},
    "mecanum": {"chassis": {"preset": "mecanum", "wheel_base_m": 0.2}},
    "car": {"chassis": {"preset": "ackermann", "wheel_base_m": 0.2}},
    "footprint": {"odometry": {"child_frame_id": "base_footprint"}},
}
NODES = {
    "robot_state_publisher": "robot_state_publisher",
    "joy": "joy_node",
    "teleop_twist_joy": "teleop_node",
    "robot_localization": "ekf_node",
    "rviz2": "rviz2",
}
OTHERS = {
    "slam_toolbox": "async_slam_toolbox_node",
    "opennav_docking": "opennav_docking",
    **{
        f"nav2_{name}": program
        for name, program in {
            "amcl": "amcl",
            "behaviors": "behavior_server",
            "bt_navigator": "bt_navigator",
            "collision_monitor": "collision_monitor",
            "controller": "controller_server",
            "lifecycle_manager": "lifecycle_manager",
            "map_server": "map_server",
            "planner": "planner_server",
            "route": "route_server",
            "smoother": "smoother_server",
            "velocity_smoother": "velocity_smoother",
            "waypoint_follower": "waypoint_follower",
        }.items()
    },
}
"""The programs that launch files of others start."""


def run(*command: object, **more) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(part) for part in command],
        check=False,
        capture_output=True,
        text=True,
        timeout=300,
        **more,
    )


@pytest.fixture
def model(request, tmp_path) -> Path:
    path = tmp_path / "robot.urdf"
    path.write_text(urdf(Config.model_validate(MODELS[request.param])))
    return path


models = pytest.mark.parametrize("model", MODELS, indirect=True)


@models
def test_the_parser_that_robot_state_publisher_uses_reads_the_model(model) -> None:
    built("bringup")
    checked = run(CACHE / "bringup" / "bin" / "check_urdf", model)
    assert checked.returncode == 0, checked.stderr
    assert "Successfully Parsed XML" in checked.stdout
    root = "base_footprint" if "base_footprint_joint" not in model.read_text() else "base_link"
    assert f"root Link: {root} has" in checked.stdout


@models
def test_xacro_and_a_reader_in_python_read_the_model(model) -> None:
    python = built("bringup")
    assert run(python.with_name("xacro"), model).returncode == 0
    code = (
        "import sys; from urdf_parser_py.urdf import URDF; r = URDF.from_xml_file(sys.argv[1]);"
        "print(r.get_root(), *sorted(j.name for j in r.joints if j.type == 'continuous'))"
    )
    root, *wheels = run(python, "-c", code, model).stdout.split()
    assert root in ("base_link", "base_footprint")
    assert len(wheels) in (2, 4)
    assert all(wheel.endswith("_wheel_joint") for wheel in wheels)


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """The package, built and installed by colcon."""
    python = built("bringup")
    workspace = tmp_path_factory.mktemp("workspace")
    shutil.copytree(PACKAGE, workspace / "src" / "yahboomd_bringup")
    done = run(
        python.with_name("colcon"), "--log-base", workspace / "log", "build", cwd=workspace,
        env={**os.environ, "PATH": f"{python.parent}:{os.environ['PATH']}"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return workspace / "install" / "yahboomd_bringup"


def test_colcon_builds_it_with_all_of_its_files(installed) -> None:
    share = installed / "share" / "yahboomd_bringup"
    for kind in ("launch", "rviz"):
        ours = {path.name for path in (PACKAGE / kind).iterdir() if path.suffix != ".pyc"}
        assert {path.name for path in (share / kind).iterdir()} == ours - {"__pycache__"}
    assert (share / "package.xml").is_file()
    assert (installed / "lib/yahboomd_bringup/resident").is_file()
    index = installed / "share" / "ament_index" / "resource_index" / "packages"
    assert (index / "yahboomd_bringup").is_file()


def ask(
    installed: Path, code: str, *arguments: str, sourced: str = "kilted"
) -> subprocess.CompletedProcess[str]:
    (modules,) = installed.glob("lib/python*/site-packages")
    environment = {**os.environ, "PYTHONPATH": str(modules), "ROS_DISTRO": sourced}
    head = "import sys; from yahboomd_bringup.robot import Robot;"
    return run(built("bringup"), "-c", head + code, *arguments, env=environment)


def test_it_asks_yahboomd_for_the_robot_and_knows_the_distribution(installed, tmp_path) -> None:
    config = tmp_path / "config.toml"
    config.write_text('zenoh.namespace = "bot1"\nlimits.linear.velocity = 0.2\n')
    code = (
        "r = Robot(*sys.argv[1:]); print(r.namespace, r.joystick_source, r.facts['ros2']['distro'],"
        " r.parameters('nav2')['velocity_smoother']['ros__parameters']['max_velocity'][0],"
        " r.urdf().count('continuous'))"
    )
    asked = ask(installed, code, str(config), YAHBOOMD)
    assert asked.stdout.split() == ["bot1", "cmd_vel/teleop", "kilted", "0.2", "2"], asked.stderr


@pytest.mark.parametrize(
    ("text", "command", "said"),
    [
        ("[serial]\nbaudrate = 'fast'\n", YAHBOOMD, "config.toml:2: serial.baudrate"),
        (
            "",
            "/nowhere/yahboomd",
            "/nowhere/yahboomd cannot be started (No such file or directory)",
        ),
    ],
)
def test_a_mistake_is_named_in_yahboomds_words(installed, tmp_path, text, command, said) -> None:
    config = tmp_path / "config.toml"
    config.write_text(text)
    assert said in ask(installed, "Robot(*sys.argv[1:])", str(config), command).stderr


def test_a_distribution_that_is_unknown_is_refused_with_the_nearest_one(installed) -> None:
    code = "print(Robot(*sys.argv[1:]).facts['ros2']['distro'])"
    refused = ask(installed, code, "", YAHBOOMD, sourced="mango").stderr
    assert 'or "rolling", got "mango"; the nearest is "lyrical"' in refused
    assert "distro:=NAME" in refused
    named = ask(installed, code, "", YAHBOOMD, "lyrical", sourced="mango")
    assert named.stdout == "lyrical\n", named.stderr
    assert ask(installed, code, "", YAHBOOMD, sourced="").stdout == "jazzy\n"


def test_what_is_laid_over_a_file_replaces_values_and_leaves_the_rest(installed) -> None:
    code = (
        "from yahboomd_bringup.parameters import merged;"
        "own = {'a': {'b': 1, 'c': {'d': 2}}, 'e': 3};"
        "print(merged(own, {'a': {'c': {'d': 4, 'f': 5}}, 'e': {'g': 6}})); print(own)"
    )
    after, before = ask(installed, code).stdout.splitlines()
    assert after == "{'a': {'b': 1, 'c': {'d': 4, 'f': 5}}, 'e': {'g': 6}}"
    assert before == "{'a': {'b': 1, 'c': {'d': 2}}, 'e': 3}"


@pytest.fixture(scope="session")
def launch_python() -> str:
    python = os.environ.get("YAHBOOMD_LAUNCH_PYTHON") or shutil.which("python3") or sys.executable
    if run(python, "-c", "import launch_ros.actions").returncode:
        pytest.skip("no `launch` here: source a ROS 2 installation")
    return python


def found_package(name: str) -> Path | None:
    """The shared files of an installed package."""
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(":")
    return next((p for each in prefixes if (p := Path(each, "share", name)).is_dir()), None)


def need(*packages: str) -> None:
    for name in packages:
        if found_package(name) is None:
            pytest.skip(f"no {name} here: source a ROS 2 installation with it")


@pytest.fixture
def environment(installed, launch_python, tmp_path) -> dict[str, str]:
    """Of a workspace with the package, and stand-ins in place of all nodes."""
    prefix = tmp_path / "prefix"
    for package, program in {**NODES, **OTHERS}.items():
        stand_in = prefix / "lib" / package / program
        stand_in.parent.mkdir(parents=True)
        stand_in.write_text(f'#!/bin/sh\nexec {launch_python} {STAND_IN} {program} "$@"\n')
        stand_in.chmod(0o755)
        share = prefix / "share" / package
        share.parent.mkdir(parents=True, exist_ok=True)
        own = found_package(package)
        share.symlink_to(own) if own else share.mkdir()
        marker = prefix / "share/ament_index/resource_index/packages" / package
        marker.parent.mkdir(parents=True, exist_ok=True)
        marker.touch()
    (modules,) = installed.glob("lib/python*/site-packages")
    others = (os.environ.get(name, "") for name in ("AMENT_PREFIX_PATH", "PYTHONPATH"))
    prefixes, paths = ([each] if each else [] for each in others)
    return {
        **os.environ,
        "AMENT_PREFIX_PATH": ":".join([str(installed), str(prefix), *prefixes]),
        "PYTHONPATH": ":".join([str(modules), *paths]),
        "ROS_DOMAIN_ID": str(free_domain()),
        "ROS_LOG_DIR": str(tmp_path / "log"),
        "TMPDIR": str(tmp_path),
    }


@pytest.fixture
def launch(installed, launch_python, environment, tmp_path) -> Callable[..., list[dict]]:
    """Launches a file; the events until that number of nodes printed their parameters."""

    def start(name: str, text: str, nodes: int, *arguments: str, **more: str) -> list[dict]:
        config = tmp_path / "config.toml"
        config.write_text(text)
        file = installed / "share/yahboomd_bringup/launch" / f"{name}.launch.py"
        given = [f"config:={config}", f"yahboomd:={YAHBOOMD}", *arguments]
        process = subprocess.Popen(
            [launch_python, LAUNCHED, file, *given], text=True, env={**environment, **more},
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        events: list[dict] = []
        lines: list[str] = []
        assert process.stdin is not None
        assert process.stdout is not None
        with closing(process.stdout):
            for line in process.stdout:
                lines.append(line)
                if line.startswith("{"):
                    events.append(json.loads(line))
                if sum(event["event"] == "node" for event in events) == nodes:
                    process.stdin.close()
                    nodes = -1
        assert process.wait() == 0
        return [*events, {"event": "log", "text": "".join(lines)}]

    return start


def nodes_of(events: list[dict]) -> dict[str, dict]:
    return {event["name"]: event for event in events if event["event"] == "node"}


SLOW = 'limits.linear.velocity = 0.2\nzenoh.namespace = "bot1"\n'


def test_the_joystick_gets_its_deadman_and_its_own_key_in_the_robots_namespace(launch) -> None:
    found = nodes_of(launch("joystick", SLOW, 2, "enable_button:=6"))
    teleop = found["/bot1/teleop_twist_joy_node"]
    assert teleop["topics"]["cmd_vel"] == "/bot1/cmd_vel/teleop"
    assert teleop["parameters"]["require_enable_button"] is True
    assert teleop["parameters"]["enable_button"] == 6
    assert teleop["parameters"]["scale_linear_turbo.x"] == 0.2
    assert found["/bot1/joy_node"]["parameters"]["autorepeat_rate"] == 20.0


def test_the_model_is_the_configurations(launch) -> None:
    text = SLOW + 'ros2.frame_prefix = "bot1/"\n'
    (node,) = nodes_of(launch("robot", text, 1, "way:=none")).values()
    assert node["parameters"]["robot_description"] == urdf(
        Config.model_validate({"zenoh": {"namespace": "bot1"}})
    )
    assert node["parameters"]["frame_prefix"] == "bot1/"
    assert node["topics"]["/tf"] == "/bot1/tf"


def test_the_whole_is_what_is_switched_on(launch) -> None:
    switched = ("way:=none", "joystick:=true", "ekf:=true", "rviz:=true")
    events = launch("bringup", "ros2.publish_tf = false\n", 5, *switched)
    started = {Path(event["cmd"][0]).name for event in events if event["event"] == "start"}
    assert started == set(NODES.values())
    assert nodes_of(events)["/ekf_filter_node"]["parameters"]["odom0"] == "odom"


@pytest.mark.parametrize(
    ("name", "arguments", "said"),
    [
        ("ekf", (), "Set publish_tf = false"),
        ("robot", ("way:=native",), "needs rmw_zenoh = true under [ros2]"),
        ("robot", ("bridge_config:=/nowhere.json5",), "There is no /nowhere.json5"),
    ],
)
def test_what_cannot_work_is_refused_with_what_helps(launch, name, arguments, said) -> None:
    *events, log = launch(name, "", 0, *arguments)
    assert said in log["text"]
    assert not [event for event in events if event["event"] == "start"]


def test_natively_the_middleware_is_asked_for_and_no_bridge_started(launch) -> None:
    text = "[ros2]\nbridge = false\nrmw_zenoh = true\n"
    *_, log = launch("robot", text, 0, RMW_IMPLEMENTATION="rmw_fastrtps_cpp")
    assert "Export it before `ros2 launch`" in log["text"]


def test_nav2_and_slam_toolbox_get_their_own_files_with_the_base_laid_over(
    launch, tmp_path
) -> None:
    need("nav2_bringup", "slam_toolbox")
    mine = tmp_path / "mine.yaml"
    mine.write_text("controller_server: {ros__parameters: {FollowPath: {plugin: mine::Mine}}}\n")
    given = ("robot_radius:=0.3", f"nav2_params:={mine}")
    found = nodes_of(launch("navigation", SLOW.splitlines()[0], 11, *given))
    controller = found["/controller_server"]["parameters"]
    # A person's file, over the base's, over Nav2's own.
    assert controller["FollowPath.plugin"] == "mine::Mine"
    assert controller["FollowPath.vx_max"] == 0.2
    assert controller["FollowPath.time_steps"] == 56
    smoother = found["/velocity_smoother"]
    assert smoother["parameters"]["max_velocity"] == [0.2, 0.0, 1.9]
    # A key that only Nav2's own file has.
    assert smoother["parameters"]["velocity_timeout"] == 1.0
    assert found["/collision_monitor"]["parameters"]["base_frame_id"] == "base_link"
    (mapper,) = nodes_of(launch("slam", "", 1, "scan_topic:=/front/scan")).values()
    assert mapper["parameters"]["base_frame"] == "base_link"
    assert mapper["parameters"]["scan_topic"] == "/front/scan"
    assert mapper["parameters"]["mode"] == "mapping"


def test_slam_toolbox_maps_in_the_robots_namespace_with_its_own_transforms(launch) -> None:
    need("slam_toolbox")
    (mapper,) = nodes_of(launch("slam", SLOW, 1)).values()
    assert mapper["name"] == "/bot1/slam_toolbox"
    assert (mapper["topics"]["/tf"], mapper["topics"]["/tf_static"]) == (
        "/bot1/tf",
        "/bot1/tf_static",
    )
    parameters = mapper["parameters"]
    # Without a slash in front, so below the namespace.
    assert (parameters["scan_topic"], parameters["map_name"]) == ("scan", "map")
    # A key that only slam_toolbox's own file has.
    assert parameters["mode"] == "mapping"


def test_nav2_drives_in_the_robots_namespace_with_its_own_transforms(launch) -> None:
    need("nav2_bringup")
    text = SLOW + 'ros2.frame_prefix = "bot1/"\n'
    found = nodes_of(launch("navigation", text, 14, "map:=/room.yaml"))
    names = {name for name in found if not name.startswith("/bot1/")}
    assert names == set()
    # Those that ask where the robot is.
    for name in ("planner_server", "behavior_server", "bt_navigator", "amcl", "collision_monitor"):
        node = found[f"/bot1/{name}"]
        assert (node["topics"]["/tf"], node["topics"]["/tf_static"]) == (
            "/bot1/tf",
            "/bot1/tf_static",
        )
    amcl = found["/bot1/amcl"]["parameters"]
    assert (amcl["global_frame_id"], amcl["odom_frame_id"]) == ("bot1/map", "bot1/odom")
    assert amcl["scan_topic"] == "scan"
    monitor = found["/bot1/collision_monitor"]
    assert monitor["topics"]["cmd_vel"] == "/bot1/cmd_vel"
    assert monitor["parameters"]["FootprintApproach.footprint_topic"] == (
        "/bot1/local_costmap/published_footprint"
    )
    assert found["/bot1/velocity_smoother"]["parameters"]["max_velocity"] == [0.2, 0.0, 1.9]


BOTS = ("bot1", "bot2")
IDLE = ("lifecycle_manager", "opennav_docking", "route_server", "smoother_server",
        "velocity_smoother", "waypoint_follower")  # fmt: skip
"""They hear neither transforms nor scans."""
OF_SCANS = ("slam_toolbox", "controller_server", "planner_server", "collision_monitor")
HEARERS = (*OF_SCANS, "behavior_server", "bt_navigator")


@pytest.fixture
def bots(environment, launch_python, installed, tmp_path) -> Iterator[dict[str, Peer]]:
    """Two simulated robots behind one bridge, and what their `ros2 launch` and its nodes print.

    Each has a lidar, whose range is the number of its robot; Nav2 drives the first one.
    """
    need("nav2_bringup", "slam_toolbox")
    for program in IDLE:
        for stand_in in (tmp_path / "prefix/lib").glob(f"*/{program}"):
            stand_in.write_text("#!/bin/sh\nexec sleep 600\n")
    config = example_for("bot.", tmp_path / "bridge.json5")
    bridge = Bridge(built("bridge"), tmp_path / "bridge.log", config=config, discovery="SUBNET")
    file = installed / "share/yahboomd_bringup/launch/bringup.launch.py"
    with ExitStack() as stack:
        stack.callback(bridge.stop)
        bridge.start()
        peers = {}
        for number, name in enumerate(BOTS, 1):
            folder = tmp_path / name
            folder.mkdir()
            toml = folder / "config.toml"
            toml.write_text(
                f'zenoh.namespace = "{name}"\n[ros2]\nstatic_transforms = '
                '[{ parent = "base_link", child = "laser", x = 0.1, z = 0.2 }]\n'
            )
            here = ("--set", f'zenoh.connect=["{bridge.endpoint}"]')
            robot = RealRobot(folder, run=["--config", str(toml), *here])
            stack.callback(robot.close)
            own = {
                **environment,
                "ROS_DOMAIN_ID": str(bridge.domain),
                "ACTS": "0.1" if number == 1 else "0.0",
            }
            parts = ("way:=none", "slam:=true", "navigation:=true")
            given = (f"config:={toml}", f"yahboomd:={YAHBOOMD}", *parts)
            command = [launch_python, str(LAUNCHED), str(file), *given]
            peers[name] = start_peer(command, folder / "launch.log", own)
            # `launch` ends all of its nodes before itself.
            stack.callback(peers[name].close, 60.0)
            remaps = (f"__ns:=/{name}", "/tf:=tf", "/tf_static:=tf_static")
            remapped = [part for each in remaps for part in ("-r", each)]
            command = [launch_python, str(STAND_IN), "lidar", "--ros-args", *remapped]
            lidar = start_peer(command, folder / "lidar.log", own | {"ACTS": f"{number}"})
            stack.callback(lidar.close)
        yield peers


def drawn(events: Iterable[Event]) -> str:
    """The frames that were heard, as a tree; behind each, who was heard to say it."""
    said: dict[tuple[str, str], set[str]] = {}
    for event in events:
        if event["event"] in ("frame", "says"):
            frames = said.setdefault((event["parent"], event["child"]), set())
            if event["event"] == "says":
                frames.add(event["node"].rpartition("/")[2])
    (root,) = {parent for parent, _ in said} - {child for _, child in said}
    lines = [root]

    def below(parent: str, margin: str) -> None:
        children = sorted(child for each, child in said if each == parent)
        for child in children:
            last = child == children[-1]
            who = " and ".join(sorted(said[parent, child])) or "yahboomd"
            lines.append(f"{margin + ('└─ ' if last else '├─ ') + child:<26}{who}")
            below(child, margin + ("   " if last else "│  "))

    below(root, "")
    return "\n".join(lines)


def test_two_robots_map_and_navigate_each_with_transforms_and_scans_of_its_own(bots) -> None:
    """The tree of the page is the one that was heard."""
    (page,) = re.findall(r"```\n(map\n.*?)\n```", (ROOT / "docs/bringup.md").read_text(), re.DOTALL)
    frames = {line.split("─ ")[-1].split()[0] for line in page.splitlines()[1:]}

    def told(name: str, kind: str) -> list[Event]:
        return [event for event in list(bots[name].events) if event["event"] == kind]

    for name in BOTS:

        def complete(name: str = name) -> bool:
            heard = {(each["node"], each["child"]) for each in told(name, "frame")}
            scans = {each["node"] for each in told(name, "scan")}
            nodes = {f"/{name}/{node}" for node in OF_SCANS}
            return scans >= nodes and heard >= {
                (f"/{name}/{node}", frame) for node in HEARERS for frame in frames
            }

        wait_for(complete, f"{name}'s nodes to hear its frames and scans", 240.0)
    wait_for(lambda: len(told("bot1", "moved")) >= len(HEARERS), "all to hear that it drives")
    for number, name in enumerate(BOTS, 1):
        topics = {f"/{name}/tf", f"/{name}/tf_static"}
        assert {each["topic"] for each in told(name, "frame") + told(name, "says")} == topics
        assert {(each["topic"], each["of"]) for each in told(name, "scan")} == {
            (f"/{name}/scan", number)
        }
        assert drawn(list(bots[name].events)) == page
    assert told("bot2", "moved") == []
