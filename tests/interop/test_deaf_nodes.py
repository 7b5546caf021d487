"""Nodes that are killed and start again under their name, behind the real bridge.

The bridge forgets the route of the second one as the lease of the first one ends, unless another
node subscribes: the resident of the bring-up package.
"""

import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from itertools import count
from pathlib import Path

import pytest
from ros_peers import DISTROS, HERE, ON_LOOPBACK, built, ros_node, start_peer

pytestmark = [pytest.mark.realtime, pytest.mark.nightly, pytest.mark.timeout(1800)]

RESIDENT = HERE.parents[1] / "extras/ros2/yahboomd_bringup/yahboomd_bringup/resident.py"
YAHBOOMD = str(Path(sys.executable).with_name("yahboomd"))
CONSUMERS = ("rviz", "tf2_ros", "robot_state_publisher", "panel")
TOPICS = {"/odom", "/tf", "/joint_states", "/diagnostics", "/estopped"}
KINDS = ["jazzy", "cyclone"]
ROUNDS = 8 if os.environ.get("YAHBOOMD_INTEROP") else 1
"""A lease is 20 s with FastDDS, and 10 s with Cyclone DDS."""
QUIET_S = 3.0
"""The longest period of these topics is a second."""


@pytest.fixture
def start(ros_bridge, tmp_path):
    """Starts a node that reads, of ROS 2 or with Cyclone DDS, in the bridge's domain."""
    numbers = count()
    with ExitStack() as stack:

        def started(kind):
            if kind == "cyclone":
                python = str(built("venv"))
                setting = f"CYCLONEDDS_URI={ON_LOOPBACK}"
                node = [str(HERE / "dds_node.py"), str(ros_bridge.domain), *TOPICS]
                command = ["env", setting, python, *node]
            else:
                command = ros_node(kind, ros_bridge.domain, *CONSUMERS)
            peer = start_peer(command, tmp_path / f"reader{next(numbers)}.log")
            stack.callback(peer.close)
            return peer

        yield started


@pytest.fixture
def start_resident(ros_bridge, tmp_path):
    """Starts the resident; the file of its log."""
    python = built("ros-jazzy")
    environ = {
        **os.environ,
        "ROS_DOMAIN_ID": str(ros_bridge.domain),
        "AMENT_PREFIX_PATH": str(python.parents[1]),
    }
    numbers = count()
    with ExitStack() as stack:

        def started(*options):
            log = tmp_path / f"resident{next(numbers)}.log"
            process = subprocess.Popen(
                [python, RESIDENT, "--yahboomd", YAHBOOMD, *options],
                env=environ,
                stdout=subprocess.DEVNULL,
                stderr=stack.enter_context(log.open("w")),
            )
            stack.callback(process.wait)
            stack.callback(process.send_signal, signal.SIGINT)
            return log

        yield started


@pytest.fixture
def participants(ros_bridge, join):
    """The DDS participants that the bridge knows; those that died stay until their lease ends."""
    with join(ros_bridge.endpoint, "client") as session:
        yield lambda: {
            str(reply.ok.key_expr) for reply in session.get("@/*/ros2/dds/*") if reply.ok
        }


def heard(node):
    return {event.get("topic") for event in list(node.events)} & TOPICS


def heard_in(node, duration_s):
    """The topics that arrive in a while."""
    node.events.clear()
    time.sleep(duration_s)
    return heard(node)


def keeps(log, eventually):
    def kept():
        return all(f"{topic} is kept" in log.read_text() for topic in TOPICS)

    # A busy machine takes its time to load ROS.
    eventually(kept, "the resident to keep the topics", 180.0)


def replaced(node, start, kind, participants, eventually):
    """The node's successor of the same name, once the node was killed and its lease has ended.

    The successor starts before the kill: on a busy machine a start may outlast the lease.
    """
    eventually(lambda: heard(node) == TOPICS, "its topics")
    known = participants()
    successor = start(kind)
    node.process.send_signal(signal.SIGKILL)
    node.close()
    eventually(lambda: known - participants(), "the end of the lease")
    return successor


@pytest.mark.parametrize("kind", KINDS)
def test_alone_its_successor_goes_deaf_and_diagnostics_say_so(
    ros_bridge, robot, start, participants, eventually, kind
):
    """The fault that docs/ros2.md warns of: once it is mended, the resident can go."""
    driven = robot(ros_bridge.endpoint)
    for _ in range(ROUNDS):
        node = replaced(start(kind), start, kind, participants, eventually)
        eventually(lambda node=node: not heard_in(node, QUIET_S), "a deaf node")
        driven.daemon.says("The bridge does not send /")
        node.close()


@pytest.mark.parametrize("kind", KINDS)
def test_beside_the_resident_its_successor_hears_on(
    ros_bridge, robot, start, start_resident, participants, eventually, kind
):
    robot(ros_bridge.endpoint)
    node = start(kind)
    keeps(start_resident(), eventually)
    for _ in range(ROUNDS):
        node = replaced(node, start, kind, participants, eventually)
        node.events.clear()
        for topic in TOPICS:
            node.message(topic, what=f"{topic} after the lease")


@pytest.mark.parametrize("distro", DISTROS)
def test_the_resident_answers_calls_of_nodes_on_fastdds(
    ros_bridge, robot, start_ros_node, start_resident, distro
):
    driven = robot(ros_bridge.endpoint)
    start_resident("--connect", driven.endpoint)
    node = start_ros_node(distro=distro)
    for service, engaged in (("e_stop_trigger", True), ("e_stop_reset", False)):
        reply = node.call(f"/{service}")["reply"]
        assert reply["success"], reply
        node.message("/estopped", lambda m, wanted=engaged: m["data"] is wanted)
    assert node.call("/odometry_reset")["reply"]["success"]
    # What the daemon refuses, the answer says.
    node.order("drive", vx=0.1, hz=20)
    node.message("/odom", lambda m: m["twist"]["twist"]["linear"]["x"] > 0.05, "it drives")
    assert node.call("/e_stop_trigger")["reply"]["success"]
    refused = node.call("/e_stop_reset")["reply"]
    assert (refused["success"], "command" in refused["message"]) == (False, True)
