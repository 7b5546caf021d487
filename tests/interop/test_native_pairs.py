"""Several nodes of an rmw_zenoh graph whose router is the daemon, and how they fare beside it.

Nodes of two foreign programs: zenoh-ros2-sdk, which comes as a wheel, and ROS 2's own rclpy on
rmw_zenoh_cpp, if YAHBOOMD_RMW_ZENOH_PYTHON names an interpreter that has it.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from real_robot import Client, RealRobot, wait_for
from ros_peers import HERE, Peer, built, start_peer

pytestmark = pytest.mark.realtime

NATIVE = ["--set", "ros2.rmw_zenoh=true", "--set", "ros2.bridge=false"]
CROWD = 30
ESTABLISHED = "01"


def sdk(endpoint: str, name: str) -> list[str]:
    return [str(built("sdk")), str(HERE / "sdk_node.py"), endpoint, "0", name]


def rclpy(endpoint: str, name: str) -> list[str]:
    python = os.environ.get("YAHBOOMD_RMW_ZENOH_PYTHON")
    if not python:
        pytest.skip("no wheel brings rmw_zenoh_cpp: YAHBOOMD_RMW_ZENOH_PYTHON names what has it")
    zenoh = f'ZENOH_CONFIG_OVERRIDE=connect/endpoints=["{endpoint}"]'
    node = [python, str(HERE / "ros_node.py"), "0", "", "chatter"]
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


def heard(event: dict[str, object]) -> object:
    message = event["message"]
    return message["data"] if isinstance(message, dict) else message


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


def hears(listener: Peer, talker: Peer, text: str) -> None:
    """The one hears what the other says, if it says it often enough to be found."""

    def found() -> bool:
        talker.order("talk", text=text)
        return any(e.get("topic") == "/chatter" and heard(e) == text for e in list(listener.events))

    wait_for(found, f"{text} to be heard")


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
