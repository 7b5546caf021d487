"""Several nodes of an rmw_zenoh graph whose router is the daemon, and how they fare beside it.

Nodes of two foreign programs: zenoh-ros2-sdk, which comes as a wheel, and ROS 2's own rclpy on
rmw_zenoh_cpp, if YAHBOOMD_RMW_ZENOH_PYTHON names an interpreter that has it.
"""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from real_robot import Client, RealRobot, wait_for
from ros_peers import HERE, Peer, built, hears, sdk, start_peer

from benchmarks.rig import share_of_core, usage

pytestmark = [pytest.mark.realtime, pytest.mark.nightly]

NATIVE = ["--set", "ros2.rmw_zenoh=true", "--set", "ros2.bridge=false"]
CROWD = 30
ESTABLISHED = "01"


def rclpy(endpoint: str, name: str, *consumers: str) -> list[str]:
    python = os.environ.get("YAHBOOMD_RMW_ZENOH_PYTHON")
    if not python:
        pytest.skip("no wheel brings rmw_zenoh_cpp: YAHBOOMD_RMW_ZENOH_PYTHON names what has it")
    zenoh = f'ZENOH_CONFIG_OVERRIDE=connect/endpoints=["{endpoint}"]'
    node = [python, str(HERE / "ros_node.py"), "0", *(consumers or ("", "chatter"))]
    return ["env", "RMW_IMPLEMENTATION=rmw_zenoh_cpp", zenoh, f"ROS_NODE_NAME={name}", *node]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[[list[str]], Peer]]:
    with ExitStack() as stack:

        def start(command: list[str]) -> Peer:
            peer = start_peer(command, tmp_path / f"peer{len(list(tmp_path.iterdir()))}.log")
            stack.callback(peer.close)
            return peer

        yield start


@pytest.fixture
def natively(real_robot: Callable[..., RealRobot]) -> RealRobot:
    """A robot that is the router of its graph."""
    robot = real_robot(run=NATIVE)
    robot.daemon.says("Connected")
    return robot


def connections_out(robot: RealRobot) -> list[str]:
    """The remote ends of the daemon's connections that it did not accept at its own port."""
    pid, port = robot.daemon.process.pid, int(robot.endpoint.rpartition(":")[2])
    files = [str(each.readlink()) for each in Path(f"/proc/{pid}/fd").iterdir() if each.exists()]
    rows = [row.split() for row in Path(f"/proc/{pid}/net/tcp").read_text().splitlines()[1:]]
    return [
        remote
        for _, local, remote, state, *_, inode in (row[:10] for row in rows)
        if state == ESTABLISHED
        and f"socket:[{inode}]" in files
        and int(local.rpartition(":")[2], 16) != port
    ]


def remaps(namespace: str) -> list[str]:
    """The absolute topics of ros_node.py, in a robot's namespace."""
    names = ("/odom", "/estopped", "/tf", "/tf_static", "/cmd_vel", "/yahboomd/estop")
    return [part for name in names for part in ("-r", f"{name}:=/{namespace}{name}")]


@pytest.mark.parametrize("node", [sdk, rclpy])
def test_two_nodes_of_others_hear_each_other_and_the_robot(natively, start, node):
    one, two = (start(node(natively.endpoint, name)) for name in ("one", "two"))
    hears(two, one, "from one")
    hears(one, two, "from two")
    for each in (one, two):
        each.await_event(lambda e: e.get("topic") == "/odom", "the odometry")


@pytest.mark.parametrize("node", [sdk, rclpy])
def test_a_node_drives_beside_another_and_the_other_stops_the_robot(natively, start, client, node):
    one, two = (start(node(natively.endpoint, name)) for name in ("one", "two"))
    one.order("drive", vx=0.2, hz=20)
    onlooker: Client = client("client", natively.endpoint)
    onlooker.in_state("driving")
    assert two.call("/yahboomd/estop", data=True)["reply"]["success"]
    onlooker.in_state("estopped")
    assert "commands motion" in two.call("/yahboomd/estop/reset")["reply"]["message"]
    natively.settled_truth()
    one.order("rest")
    wait_for(lambda: two.call("/yahboomd/estop/reset")["reply"]["success"], "the release")
    onlooker.in_state("standing")


def test_drive_and_estop_beside_nodes_that_come_and_go(natively, start, client):
    """How many is CROWD: each has a connection to the router and one to every other."""
    crowd = start(
        [str(built("sdk")), str(HERE / "sdk_crowd.py"), natively.endpoint, "0", f"{CROWD}"]
    )
    node = start(sdk(natively.endpoint, "driver"))
    onlooker: Client = client("client", natively.endpoint)
    for _ in range(3):
        node.order("drive", vx=0.2, hz=20)
        onlooker.in_state("driving")
        crowd.await_event(lambda e: e["event"] == "replaced", "a node to be replaced")
        onlooker.in_state("driving")
        node.order("press", data=True)
        onlooker.in_state("estopped")
        node.order("rest")
        wait_for(lambda: node.call("/yahboomd/estop/reset")["reply"]["success"], "the release")
        onlooker.in_state("standing")
    # It knows every node that is there, and has joined none of them.
    assert connections_out(natively) == []


def test_memory_does_not_grow_with_nodes_that_come_and_go(natively, start, capsys):
    """How much CPU they take is printed: as a share of a core, alone and beside them."""
    pid = natively.daemon.process.pid
    alone_s = time.monotonic() + 4.0
    before = usage(pid)
    wait_for(lambda: time.monotonic() > alone_s, "four seconds")
    figures = [(before, usage(pid))]
    crowd = start(
        [str(built("sdk")), str(HERE / "sdk_crowd.py"), natively.endpoint, "0", f"{CROWD}"]
    )
    for replaced in (10, 40):
        crowd.await_event(lambda e: e["event"] == "replaced", "a node to be replaced")
        seen, before = len(crowd.events), usage(pid)
        wait_for(lambda end=seen + replaced: len(crowd.events) >= end, "nodes to be replaced")
        figures.append((before, usage(pid)))
    alone_mb, first_mb, second_mb = (after.rss_mb for _, after in figures)
    with capsys.disabled():
        cpu = ", ".join(f"{100.0 * share_of_core(*each):.1f}" for each in figures)
        print(f"\n{CROWD} nodes: CPU {cpu} %; {alone_mb:.1f}, {first_mb:.1f}, {second_mb:.1f} MB")
    assert first_mb < alone_mb + 20.0
    assert second_mb < first_mb + 4.0


def ros2(endpoint: str, *words: str) -> str:
    """What a command of ros2cli prints, asked without its daemon."""
    python = os.environ.get("YAHBOOMD_RMW_ZENOH_PYTHON")
    if not python or subprocess.run([python, "-c", "import ros2cli"], check=False).returncode:
        pytest.skip("no ros2cli on rmw_zenoh_cpp: YAHBOOMD_RMW_ZENOH_PYTHON names what has it")
    override = f'connect/endpoints=["{endpoint}"]'
    environment = {
        **os.environ,
        "RMW_IMPLEMENTATION": "rmw_zenoh_cpp",
        "ROS_DOMAIN_ID": "0",
        "ZENOH_CONFIG_OVERRIDE": override,
        "ZENOH_ROUTER_CHECK_ATTEMPTS": "-1",
    }
    run = "import sys; from ros2cli.cli import main; sys.exit(main())"
    done = subprocess.run(
        [python, "-c", run, *words], env=environment, check=False, capture_output=True, text=True,
        timeout=60,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_commands_of_ros2cli_see_and_stop_the_robot(natively, client):
    at = natively.endpoint
    onlooker: Client = client("client", at)
    onlooker.in_state("standing")
    assert "/yahboomd" in ros2(at, "node", "list", "--no-daemon").split()
    topics = ros2(at, "topic", "list", "--no-daemon").split()
    assert {"/odom", "/tf", "/cmd_vel", "/estopped"} <= set(topics)
    services = ros2(at, "service", "list", "--no-daemon").split()
    assert {"/yahboomd/estop", "/e_stop_trigger", "/e_stop_reset"} <= set(services)
    assert "command.timeout_s" in ros2(at, "param", "list", "--no-daemon", "/yahboomd")
    value = ros2(at, "param", "get", "--no-daemon", "/yahboomd", "command.timeout_s")
    assert "Double value is: 0.5" in value
    called = ros2(at, "service", "call", "/e_stop_trigger", "std_srvs/srv/Trigger")
    assert "success=True" in called
    onlooker.in_state("estopped")


def test_a_node_that_comes_late_gets_the_lines_of_the_log_from_before_it(natively, start, client):
    """Through the bridge it gets the last one alone (test_rclpy.py)."""
    onlooker: Client = client("client", natively.endpoint)
    for _ in range(3):
        assert onlooker.ask("yahboomd/estop")["success"]
        onlooker.in_state("estopped")
        wait_for(lambda: onlooker.ask("yahboomd/estop/reset")["success"], "the release")
        onlooker.in_state("standing")
    late = start(rclpy(natively.endpoint, "late", "log"))
    kinds = ["estop", "estop_released"]
    lines = [
        late.message("/rosout", lambda m, kind=kind: m["function"] == kind, f"a line of {kind}")
        for kind in 3 * kinds
    ]
    stamps = [(line["stamp"]["sec"], line["stamp"]["nanosec"]) for line in lines]
    assert stamps == sorted(set(stamps))


def test_transforms_of_two_robots_do_not_mix(real_robot, start):
    """As ROS 2 hears them, in one graph: the first robot is the router, the second joins it."""
    one = real_robot(run=[*NATIVE, "--set", "zenoh.namespace=bot1"])
    two = real_robot(
        run=[*NATIVE, "--set", "zenoh.namespace=bot2", "--set", f'zenoh.connect=["{one.endpoint}"]']
    )
    for each in (one, two):
        each.daemon.says("Connected")
    command = rclpy(one.endpoint, "onlooker", "", "tf2_ros")
    nodes = {name: start([*command, "--ros-args", *remaps(name)]) for name in ("bot1", "bot2")}
    nodes["bot1"].order("drive", vx=0.2, hz=20)

    def x_of(name: str) -> float:
        (transform,) = nodes[name].message("/tf")["transforms"]
        return float(transform["transform"]["translation"]["x"])

    wait_for(lambda: x_of("bot1") > 0.05, "the first robot to drive in its own transforms")
    assert x_of("bot2") == 0.0
    assert two.travelled_m() == 0.0
