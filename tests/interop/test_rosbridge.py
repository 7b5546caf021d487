"""A foreign program that is no Python: a web page's way to the robot, through a rosbridge server.

The server's wheel is linked against ROS 2 Jazzy, and runs on the libraries of its other wheels.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from real_robot import Client, RealRobot
from ros_peers import CACHE, HERE, Bridge, Peer, built, start_peer
from zenoh_fixtures import free_endpoint

pytestmark = [pytest.mark.realtime, pytest.mark.nightly]


@pytest.fixture
def page(ros_bridge: Bridge, tmp_path: Path) -> Iterator[Peer]:
    """A client of the server, which is a node on rmw_fastrtps in the bridge's domain."""
    built("ros-jazzy")
    python, ros = built("rosbridge"), CACHE / "ros-jazzy"
    environment = {
        "ROS_DOMAIN_ID": str(ros_bridge.domain),
        "AMENT_PREFIX_PATH": str(ros),
        "LD_LIBRARY_PATH": os.pathsep.join(
            map(str, (CACHE / "rosbridge/lib", ros / "lib", *ros.glob("lib/python*/*/ros_*.libs")))
        ),
    }
    settings = [f"{name}={value}" for name, value in environment.items()]
    command = [python, HERE / "rosbridge_node.py", CACHE / "rosbridge/bin/server"]
    port = free_endpoint().rpartition(":")[2]
    peer = start_peer(["env", *settings, *map(str, command), port], tmp_path / "page.log")
    yield peer
    peer.close()


def test_a_page_behind_rosbridge_hears_drives_and_stops_the_robot(
    ros_bridge: Bridge,
    page: Peer,
    robot: Callable[..., RealRobot],
    client: Callable[..., Client],
    eventually: Callable[..., bool],
) -> None:
    driven = robot(ros_bridge.endpoint)
    onlooker = client("client", ros_bridge.endpoint)
    assert not page.message("/estopped")["data"]
    page.order("drive", vx=0.2, hz=20)
    onlooker.in_state("driving")
    odom = page.message("/odom", lambda m: m["twist"]["twist"]["linear"]["x"] > 0.15)
    assert (odom["header"]["frame_id"], odom["child_frame_id"]) == ("odom", "base_link")

    def stopped() -> bool:
        # DDS may lose what is published before the reader knows its writer as well.
        page.order("press", data=True)
        return "Emergency stop engaged" in driven.daemon.output

    eventually(stopped, "the emergency stop")
    assert page.message("/estopped", lambda m: m["data"])["data"]
    page.order("rest")
    driven.settled_truth()
