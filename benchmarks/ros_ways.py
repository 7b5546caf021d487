"""The ways into ROS 2 that ``ros`` compares, each with every process that it needs.

ROS 2 itself is the environment that ``make interop`` builds (`ros-jazzy`, with FastDDS). No wheel
brings ``rmw_zenoh_cpp``: YAHBOOMD_RMW_ZENOH_PYTHON names an interpreter whose ``rclpy`` has it.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import socket
from functools import partial
from pathlib import Path

import serial
import zenoh

from benchmarks import rig
from benchmarks.drivers import STARTS, WHEELS, ArticleDriver, Started
from benchmarks.results import ROOT, NotHere
from yahboomd.ros2.messages import ros2_encoders, ros2_names

NODE, BRIDGE, NATIVE = WAYS = (
    "the article's node",
    "yahboomd, through the bridge",
    "yahboomd, natively",
)
BY_KEYS = "yahboomd, natively, by a Zenoh program"
"""A program that uses rmw_zenoh's keys and CDR stands in for the commanding node."""
OWN_WORK = (
    *("odometry.poll_rate_hz=18", "odometry.publish_rate_hz=18", "command.rate_hz=20"),
    *(f"ros2.{topic}=false" for topic in ("publish_tf", "joint_states", "imu", "battery_state",
                                          "diagnostics")),
)  # fmt: skip
"""The daemon does what the article's node does: its polls a second, `/cmd_vel` and `/odom`."""
CACHE = (
    Path(
        os.environ.get("YAHBOOMD_CACHE")
        or Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "yahboomd"
    )
    / "interop"
)
LOOPBACK = (
    "<CycloneDDS><Domain><General><Interfaces>"
    '<NetworkInterface name="lo"/></Interfaces></General></Domain></CycloneDDS>'
)
DOMAINS = itertools.count(110 + os.getpid() % 60)
"""Each trial has a domain of its own; DDS has ports for those up to 232."""


class RosDriver(ArticleDriver):
    """A ROS 2 node that commands and listens, behind the socket that the bridge has too."""

    def __init__(self, connection: socket.socket, where: Path) -> None:
        super().__init__(connection, where / "poses")
        self._where = where

    def arrivals(self) -> list[tuple[int, float]]:
        """The time at which each ``/odom`` reached its callback, and its x."""
        return [(t_ns, x) for t_ns, x, *_ in _lines(self._where / "poses")]

    def sent(self) -> list[tuple[int, float]]:
        """The time at which each velocity was published, and its vx."""
        return [(t_ns, vx) for t_ns, vx in _lines(self._where / "sent")]


def ros_python() -> str:
    """The interpreter with ``rclpy`` on FastDDS.

    Raises:
        NotHere: There is none.
    """
    path = CACHE / "ros-jazzy" / "bin" / "python"
    if not path.exists():
        raise NotHere(f"ROS 2 is not built: `make interop` builds it ({path} is missing)")
    return str(path)


def native_python() -> str | None:
    """The interpreter whose ``rclpy`` has ``rmw_zenoh_cpp``, if one is named."""
    return os.environ.get("YAHBOOMD_RMW_ZENOH_PYTHON")


def ways() -> list[str]:
    """The ways that can be measured here.

    Raises:
        NotHere: Not even the first two.
    """
    ros_python()
    if not (program := CACHE / "bin" / "current" / "bridge").exists():
        raise NotHere(f"the bridge is not built: `make interop` builds it ({program} is missing)")
    return list(WAYS if native_python() else WAYS[:2])


def start_node(stack: contextlib.ExitStack, where: Path, _: tuple[str, ...]) -> Started:
    """The article's node, and a node that commands it, over FastDDS."""
    environ = _environ(ros_python(), where)
    node = rig.Process(
        *("-m", "benchmarks.ros_article", str(where / "board")),
        program=ros_python(), environ=environ,
    )  # fmt: skip
    stack.enter_context(node).says("ready")
    return Started(_meter(stack, where, ros_python(), environ), (node,))


def start_bridge(stack: contextlib.ExitStack, where: Path, settings: tuple[str, ...]) -> Started:
    """The daemon, ``zenoh-bridge-ros2dds``, and a node over FastDDS."""
    environ = _environ(ros_python(), where)
    endpoint = rig.free_endpoint()
    bridge = rig.Process(
        *(str(ROOT / "examples" / "zenoh-bridge-ros2dds.json5"), endpoint),
        program=str(CACHE / "bin" / "current" / "bridge"),
        environ={
            **environ,
            "CYCLONEDDS_URI": LOOPBACK,
            "ROS_DISTRO": "jazzy",
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
        },
    )
    stack.enter_context(bridge)
    daemon = _daemon(stack, where, settings, connect=(endpoint,))
    return Started(_meter(stack, where, ros_python(), environ), (daemon, bridge))


def start_native(stack: contextlib.ExitStack, where: Path, settings: tuple[str, ...]) -> Started:
    """The daemon, and a node over rmw_zenoh that connects to the daemon's own port."""
    python = native_python()
    assert python is not None
    endpoint = rig.free_endpoint()
    own = ("ros2.bridge=false", "ros2.rmw_zenoh=true")
    daemon = _daemon(stack, where, (*own, *settings), endpoint=endpoint)
    session = where / "session.json5"
    session.write_text(
        json.dumps(
            {
                "mode": "peer",
                "connect": {"endpoints": [endpoint]},
                "listen": {"endpoints": ["tcp/127.0.0.1:0"]},
                "scouting": {"multicast": {"enabled": False}},
                "timestamping": {"enabled": True},
            }
        )
    )
    environ = {
        **_environ(python, where),
        "RMW_IMPLEMENTATION": "rmw_zenoh_cpp",
        "ROS_DOMAIN_ID": "0",
        "ZENOH_SESSION_CONFIG_URI": str(session),
        "ZENOH_ROUTER_CHECK_ATTEMPTS": "-1",
    }
    return Started(_meter(stack, where, python, environ), (daemon,))


class KeysDriver(RosDriver):
    """A Zenoh program that commands and listens as a node of rmw_zenoh does."""

    def __init__(self, session: zenoh.Session, where: Path) -> None:
        self._where = where
        node = ros2_names.Node(domain_id=0, zid="0", namespace="", name="meter")
        key = partial(ros2_names.native_key, node, distro="jazzy")
        self._poses = 0
        session.declare_subscriber(key(topic="odom", ros_type=ros2_names.ODOMETRY), self._heard)
        self._put = session.declare_publisher(key(topic="cmd_vel", ros_type=ros2_names.TWIST)).put
        rig.wait_for(lambda: self._poses or None, "/odom")

    def _heard(self, _: zenoh.Sample) -> None:
        self._poses += 1

    def say(self, vx: float, wz: float = 0.0) -> None:
        """Publish a velocity."""
        self._put(ros2_encoders.twist((vx, 0.0, 0.0, 0.0, 0.0, wz)))


def start_keys(stack: contextlib.ExitStack, where: Path, settings: tuple[str, ...]) -> Started:
    """The daemon, and a Zenoh program on the keys of rmw_zenoh's graph."""
    endpoint = rig.free_endpoint()
    own = ("ros2.bridge=false", "ros2.rmw_zenoh=true")
    daemon = _daemon(stack, where, (*own, *settings), endpoint=endpoint)
    return Started(KeysDriver(stack.enter_context(rig.client(endpoint)), where), (daemon,))


STARTS |= {NODE: start_node, BRIDGE: start_bridge, NATIVE: start_native, BY_KEYS: start_keys}


def _daemon(
    stack: contextlib.ExitStack,
    where: Path,
    settings: tuple[str, ...],
    *,
    endpoint: str | None = None,
    connect: tuple[str, ...] = (),
) -> rig.Process:
    endpoint = endpoint or rig.free_endpoint()
    daemon = rig.daemon(where, endpoint, *WHEELS, *settings, port="board", connect=connect)
    stack.enter_context(daemon)
    with rig.client(endpoint) as session:
        rig.Status(session).ready()
    return daemon


def _meter(
    stack: contextlib.ExitStack, where: Path, python: str, environ: dict[str, str]
) -> RosDriver:
    port = rig.free_endpoint().rpartition(":")[2]
    arguments = ("-m", "benchmarks.ros_meter", port, str(where / "poses"), str(where / "sent"))
    meter = stack.enter_context(rig.Process(*arguments, program=python, environ=environ))
    meter.says("ready")
    connection = stack.enter_context(socket.create_connection(("127.0.0.1", int(port))))
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return RosDriver(connection, where)


def _environ(python: str, where: Path) -> dict[str, str]:
    # The wheels have no pyserial: ours is pure Python.
    modules = where / "modules"
    modules.mkdir()
    (modules / "serial").symlink_to(Path(serial.__file__).parent)
    return {
        "PYTHONPATH": str(modules),
        "AMENT_PREFIX_PATH": os.environ.get("AMENT_PREFIX_PATH") or str(Path(python).parents[1]),
        "ROS_DOMAIN_ID": str(next(DOMAINS)),
        "ROS_LOG_DIR": str(where / "log"),
    }


def _lines(path: Path) -> list[list[float]]:
    return [json.loads(line) for line in path.read_text().splitlines()]
