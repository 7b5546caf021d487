"""Real peers: the bridge, a DDS node, an rmw_zenoh node, a router; each on ports of its own.

And a session that stands where yahboomd stands, for what its design takes for granted of them.
"""

import json
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import zenoh
from real_robot import RealRobot
from ros_graph import graph, graphs, row
from ros_peers import (
    HERE,
    Bridge,
    Event,
    Peer,
    built,
    hears,
    ros_node,
    sdk,
    start_peer,
    until,
)
from zenoh_fixtures import free_endpoint

from yahboomd.ros2.messages import ros2_encoders, ros2_names

LASER = 'ros2.static_transforms=[{parent="base_link",child="laser",x=0.1,yaw=1.5707963267948966}]'

FAR = "10000000,0,10000000,0"
"""Counters far from those after a reset, so that a delayed board loses no way."""

__all__ = ["graph", "graphs", "row"]


@dataclass(frozen=True)
class Spoken:
    """A message as yahboomd encodes it, and what of it a ROS node must read."""

    ros_type: str
    payload: bytes
    read: Event
    latched: bool = False


@pytest.fixture
def spoken() -> dict[str, Spoken]:
    """One message for every topic that a robot base publishes, its numbers all different."""
    stamp_ns = 1_700_000_000_123_456_789
    stamp = {"sec": 1_700_000_000, "nanosec": 123_456_789}
    header = {"stamp": stamp, "frame_id": "odom"}
    pose = (1.5, -2.25, 0.125, 0.1, 0.2, 0.3, 0.9)
    position, orientation = (
        dict(zip("xyz", pose, strict=False)),
        dict(zip("xyzw", pose[3:], strict=True)),
    )
    pose_covariance = [number / 8 for number in range(36)]
    twist = (0.5, -0.25, 0.0625, 0.01, 0.02, -0.75)
    twist_covariance = [number / -16 for number in range(36)]
    transform = {"translation": position, "rotation": orientation}
    linear, angular = (
        dict(zip("xyz", twist, strict=False)),
        dict(zip("xyz", twist[3:], strict=True)),
    )
    wheels = ("front_left_wheel_joint", "front_right_wheel_joint")
    return {
        "/odom": Spoken(
            ros2_names.ODOMETRY,
            ros2_encoders.odometry("odom", "base_link")(
                stamp_ns, pose, pose_covariance, twist, twist_covariance
            ),
            {
                "header": header,
                "child_frame_id": "base_link",
                "pose": {
                    "pose": {"position": position, "orientation": orientation},
                    "covariance": pose_covariance,
                },
                "twist": {
                    "twist": {"linear": linear, "angular": angular},
                    "covariance": twist_covariance,
                },
            },
        ),
        "/tf": Spoken(
            ros2_names.TF_MESSAGE,
            ros2_encoders.transforms([("odom", "base_link")])(stamp_ns, [pose]),
            {
                "transforms": [
                    {"header": header, "child_frame_id": "base_link", "transform": transform}
                ]
            },
        ),
        "/tf_static": Spoken(
            ros2_names.TF_MESSAGE,
            ros2_encoders.transforms([("odom", "imu_link"), ("odom", "laser")])(
                stamp_ns, [pose, pose]
            ),
            {
                "transforms": [
                    {"header": header, "child_frame_id": child, "transform": transform}
                    for child in ("imu_link", "laser")
                ]
            },
            latched=True,
        ),
        "/joint_states": Spoken(
            ros2_names.JOINT_STATE,
            ros2_encoders.joint_state("odom", wheels)(stamp_ns, (0.5, -1.5), (2.5, -3.5)),
            {
                "header": header,
                "name": list(wheels),
                "position": [0.5, -1.5],
                "velocity": [2.5, -3.5],
                "effort": [],
            },
        ),
        "/battery_state": Spoken(
            ros2_names.BATTERY_STATE,
            ros2_encoders.battery_state("odom")(stamp_ns, 12.25, 0.75),
            {
                "header": header,
                "voltage": 12.25,
                "percentage": 0.75,
                "present": True,
                "cell_voltage": [],
                "location": "",
                "serial_number": "",
            },
        ),
        "/diagnostics": Spoken(
            ros2_names.DIAGNOSTIC_ARRAY,
            ros2_encoders.diagnostics(
                stamp_ns,
                "odom",
                [
                    ros2_encoders.Diagnostic(
                        0, "yahboomd: board", "fine", "yahboom", [("volts", "12.2")]
                    ),
                    ros2_encoders.Diagnostic(
                        1, "yahboomd: bus", "slow", "", [("a", ""), ("", "b")]
                    ),
                ],
            ),
            {
                "header": header,
                "status": [
                    {
                        "level": 0,
                        "name": "yahboomd: board",
                        "message": "fine",
                        "hardware_id": "yahboom",
                        "values": [{"key": "volts", "value": "12.2"}],
                    },
                    {
                        "level": 1,
                        "name": "yahboomd: bus",
                        "message": "slow",
                        "hardware_id": "",
                        "values": [{"key": "a", "value": ""}, {"key": "", "value": "b"}],
                    },
                ],
            },
        ),
    }


@pytest.fixture
def join() -> Callable[..., AbstractContextManager[zenoh.Session]]:
    """Opens a session where yahboomd's would be: a router that connects, or another mode."""

    def open_session(endpoint: str, mode: str = "router") -> zenoh.Session:
        config = zenoh.Config()
        config.insert_json5("mode", json.dumps(mode))
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
        config.insert_json5("listen/endpoints", "[]")
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("scouting/gossip/enabled", "false")
        config.insert_json5("timestamping/enabled", "true")
        return zenoh.open(config)

    return open_session


@pytest.fixture
def eventually() -> Callable[..., Any]:
    """Waits for a condition: `eventually(lambda: ..., "its name")` is its first true value."""
    return until


@pytest.fixture
def bridge(tmp_path: Path) -> Iterator[Bridge]:
    """The bridge, running; it may be stopped and started."""
    bridge = Bridge(built("bridge"), tmp_path / "bridge.log")
    try:
        bridge.start()
        yield bridge
    finally:
        bridge.stop()


@pytest.fixture
def start_dds_node(bridge: Bridge, tmp_path: Path) -> Iterator[Callable[..., Peer]]:
    """Starts ROS 2 nodes over DDS in the bridge's domain: on all topics, or on those named."""
    with ExitStack() as stack:

        def start(*topics: str) -> Peer:
            command = [str(built("venv")), str(HERE / "dds_node.py"), str(bridge.domain), *topics]
            peer = start_peer(command, tmp_path / f"dds_node_{time.monotonic_ns()}.log")
            stack.callback(peer.close)
            return peer

        yield start


@pytest.fixture
def ros_bridge(tmp_path: Path) -> Iterator[Bridge]:
    """The bridge beside ROS 2 as it is installed: discovery by multicast, but on loopback."""
    bridge = Bridge(built("bridge"), tmp_path / "bridge.log", discovery="SUBNET")
    try:
        bridge.start()
        yield bridge
    finally:
        bridge.stop()


@pytest.fixture
def start_ros_node(ros_bridge: Bridge, tmp_path: Path) -> Iterator[Callable[..., Peer]]:
    """Starts nodes of ROS 2 itself on rmw_fastrtps, in the bridge's domain: as the consumers that
    are named, of a distribution; ``settings`` are of their environment, each ``NAME=value``."""
    with ExitStack() as stack:

        def start(*consumers: str, distro: str = "jazzy", settings: tuple[str, ...] = ()) -> Peer:
            command = ["env", *settings, *ros_node(distro, ros_bridge.domain, *consumers)]
            peer = start_peer(command, tmp_path / f"ros_node_{time.monotonic_ns()}.log")
            stack.callback(peer.close)
            return peer

        yield start


@pytest.fixture
def dds_node(start_dds_node: Callable[..., Peer]) -> Peer:
    """A ROS 2 node over DDS that hears every topic of a robot base."""
    return start_dds_node()


@dataclass(frozen=True)
class Router:
    endpoint: str
    session: zenoh.Session


@pytest.fixture
def router() -> Iterator[Router]:
    """A router like rmw_zenoh's daemon: it listens and forwards, and publishes nothing itself."""
    endpoint = free_endpoint()
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as session:
        yield Router(endpoint, session)


@pytest.fixture
def start_native_node(router: Router, tmp_path: Path) -> Iterator[Callable[..., Peer]]:
    """Starts nodes as rmw_zenoh's are, in domain 0 of the router, or of whatever listens at an
    endpoint: peers that listen on loopback."""
    with ExitStack() as stack:

        def start(endpoint: str = router.endpoint) -> Peer:
            log = tmp_path / f"native_{time.monotonic_ns()}.log"
            peer = start_peer([str(built("native")), endpoint, "0"], log)
            stack.callback(peer.close)
            return peer

        yield start


@pytest.fixture
def start_pair(tmp_path: Path) -> Iterator[Callable[[str], Callable[[str], None]]]:
    """Starts two foreign nodes that talk in the graph of an endpoint: ``talk = start_pair(it)``,
    and each hears what the other says at ``talk("now")``."""
    with ExitStack() as stack:

        def start(endpoint: str) -> Callable[[str], None]:
            def join(name: str) -> Peer:
                log = tmp_path / f"{name}_{time.monotonic_ns()}.log"
                peer = start_peer(sdk(endpoint, name), log)
                stack.callback(peer.close)
                return peer

            with ThreadPoolExecutor(2) as pool:
                one, two = pool.map(join, ("one", "two"))

            def talk(when: str) -> None:
                hears(two, one, f"one {when}")
                hears(one, two, f"two {when}")

            talk("at first")
            return talk

        yield start


@pytest.fixture
def native_node(start_native_node: Callable[..., Peer]) -> Peer:
    return start_native_node()


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Callable[..., RealRobot]]:
    """Starts a robot that joins a router, with settings such as ``ros2.rmw_zenoh=true``."""
    robots: list[RealRobot] = []

    def start(endpoint: str, *settings: str, dialect: str = "streamed") -> RealRobot:
        run = [f'zenoh.connect=["{endpoint}"]', LASER, *settings]
        folder = tmp_path / f"robot{len(robots)}"
        folder.mkdir()
        sets = [part for each in run for part in ("--set", each)]
        robots.append(RealRobot(folder, simulate=("--dialect", dialect, "--ticks", FAR), run=sets))
        robots[-1].daemon.says("Connected")
        return robots[-1]

    yield start
    for each in robots:
        each.close()
