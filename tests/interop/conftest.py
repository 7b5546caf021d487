"""Real peers: the bridge, a DDS node, an rmw_zenoh node, a router; each on ports of its own.

And a session that stands where yahboomd stands, for what its design takes for granted of them.
"""

import json
import os
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import zenoh
from real_robot import RealRobot
from zenoh_fixtures import free_endpoint

from yahboomd.messages import cdr, ros2

HERE = Path(__file__).parent
EXAMPLE = HERE.parent.parent / "examples" / "zenoh-bridge-ros2dds.json5"
CACHE = (
    Path(
        os.environ.get("YAHBOOMD_CACHE")
        or Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "yahboomd"
    )
    / "interop"
)
PATIENCE_S = 30.0
"""The time that a condition may take: DDS discovery needs a second or two, a busy machine more."""

LASER = 'ros2.static_transforms=[{parent="base_link",child="laser",x=0.1,yaw=1.5707963267948966}]'

Event = dict[str, Any]


def built(name: str) -> Path:
    """The program or environment `name` out of the cache, or a skip that says how to get it."""
    environments = ("venv", "jazzy")
    path = CACHE / (f"{name}/bin/python" if name in environments else f"bin/current/{name}")
    if not path.exists():
        pytest.skip(f"{name} is not built: `make interop` builds it ({path} is missing)")
    return path


def free_domain() -> int:
    """A DDS domain whose ports are free: they are fixed, 250 to a domain from 7400 on."""
    # Workers that run side by side begin ten domains apart.
    first = 10 * int(os.environ.get("PYTEST_XDIST_WORKER", f"gw{os.getpid()}")[2:]) % 100
    for domain in (1 + (first + step) % 100 for step in range(100)):
        with ExitStack() as stack:
            try:
                for port in (7400, 7410, 7411, 7412, 7413):
                    probe = stack.enter_context(socket.socket(type=socket.SOCK_DGRAM))
                    probe.bind(("127.0.0.1", port + 250 * domain))
            except OSError:
                continue
            return domain
    raise RuntimeError("every DDS domain is in use")


def until(condition: Callable[[], Any], what: str, patience_s: float = PATIENCE_S) -> Any:
    """The first true value of `condition`."""
    deadline_s = time.monotonic() + patience_s
    while not (value := condition()):
        if time.monotonic() > deadline_s:
            pytest.fail(f"waited {patience_s:.0f} s in vain for {what}")
        time.sleep(0.02)
    return value


def subject(event: Event) -> tuple[str, str]:
    return event["event"], event.get("topic", event.get("service", ""))


@dataclass
class Peer:
    """A program that takes orders and tells events, both as JSON lines."""

    process: subprocess.Popen[str]
    log: Path
    events: list[Event] = field(default_factory=list)
    news: threading.Condition = field(default_factory=threading.Condition)

    def __post_init__(self) -> None:
        self.reader = threading.Thread(target=self._read, daemon=True)
        self.reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            with self.news:
                self.events.append(json.loads(line))
                self.news.notify_all()
        with self.news:
            self.news.notify_all()

    def order(self, do: str, **what: Any) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps({"do": do, **what}) + "\n")
        self.process.stdin.flush()

    def await_event(
        self, wanted: Callable[[Event], bool], what: str, patience_s: float = PATIENCE_S
    ) -> Event:
        """The first event that is `wanted`; it and older ones of its subject are used up."""
        deadline_s = time.monotonic() + patience_s
        with self.news:
            while True:
                for index, event in enumerate(self.events):
                    if wanted(event):
                        older = [e for e in self.events[:index] if subject(e) != subject(event)]
                        self.events[: index + 1] = older
                        return event
                left_s = deadline_s - time.monotonic()
                if left_s <= 0 or self.process.poll() is not None:
                    heard = sorted({str(e.get("topic", e["event"])) for e in self.events})
                    pytest.fail(
                        f"{what}: not within {patience_s:.0f} s; heard {heard};"
                        f" stderr: {self.log.read_text()[-2000:]}"
                    )
                self.news.wait(min(left_s, 0.5))

    def message(
        self, topic: str, wanted: Callable[[Event], bool] = lambda _: True, what: str = ""
    ) -> Event:
        """The next message on `topic` that is `wanted`."""
        event = self.await_event(
            lambda e: e["event"] == "message" and e["topic"] == topic and wanted(e["message"]),
            what or f"a message on {topic}",
        )
        return dict(event["message"])

    def call(self, service: str, data: bool | None = None) -> Event:
        """Ask a service (SetBool with `data`, else Trigger): the event `reply` or `no_reply`."""
        self.order("call", service=service, **({} if data is None else {"data": data}))
        return self.await_event(
            lambda e: e["event"] in ("reply", "no_reply") and e["service"] == service,
            f"the end of a call of {service}",
        )

    def graph(self) -> Event:
        self.order("graph")
        return dict(self.await_event(lambda e: e["event"] == "graph", "the graph")["graph"])

    def close(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.close()
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.reader.join()
        assert self.process.stdout is not None
        self.process.stdout.close()


def start_peer(command: list[str], log: Path) -> Peer:
    with log.open("w") as stderr:
        process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=stderr, text=True
        )
    peer = Peer(process, log)
    peer.await_event(lambda e: e["event"] == "ready", f"{command[0]} to be ready")
    return peer


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
            ros2.ODOMETRY,
            cdr.odometry("odom", "base_link")(
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
            ros2.TF_MESSAGE,
            cdr.transforms([("odom", "base_link")])(stamp_ns, [pose]),
            {
                "transforms": [
                    {"header": header, "child_frame_id": "base_link", "transform": transform}
                ]
            },
        ),
        "/tf_static": Spoken(
            ros2.TF_MESSAGE,
            cdr.transforms([("odom", "imu_link"), ("odom", "laser")])(stamp_ns, [pose, pose]),
            {
                "transforms": [
                    {"header": header, "child_frame_id": child, "transform": transform}
                    for child in ("imu_link", "laser")
                ]
            },
            latched=True,
        ),
        "/joint_states": Spoken(
            ros2.JOINT_STATE,
            cdr.joint_state("odom", wheels)(stamp_ns, (0.5, -1.5), (2.5, -3.5)),
            {
                "header": header,
                "name": list(wheels),
                "position": [0.5, -1.5],
                "velocity": [2.5, -3.5],
                "effort": [],
            },
        ),
        "/battery_state": Spoken(
            ros2.BATTERY_STATE,
            cdr.battery_state("odom", location="deck", serial_number="7")(stamp_ns, 12.25, 0.75),
            {
                "header": header,
                "voltage": 12.25,
                "percentage": 0.75,
                "present": True,
                "cell_voltage": [],
                "location": "deck",
                "serial_number": "7",
            },
        ),
        "/diagnostics": Spoken(
            ros2.DIAGNOSTIC_ARRAY,
            cdr.diagnostics(
                stamp_ns,
                "odom",
                [
                    cdr.Diagnostic(0, "yahboomd: board", "fine", "yahboom", [("volts", "12.2")]),
                    cdr.Diagnostic(1, "yahboomd: bus", "slow", "", [("a", ""), ("", "b")]),
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
    """Waits for a condition: `eventually(lambda: ..., "what it is")` is its first true value."""
    return until


@dataclass
class Bridge:
    """The real bridge with the example's configuration, but for the port; DDS on loopback."""

    program: Path
    log: Path
    config: Path = EXAMPLE
    discovery: str = "LOCALHOST"
    port: int = field(default_factory=lambda: int(free_endpoint().rpartition(":")[2]))
    domain: int = field(default_factory=free_domain)
    process: subprocess.Popen[bytes] | None = None

    @property
    def endpoint(self) -> str:
        return f"tcp/127.0.0.1:{self.port}"

    def start(self) -> None:
        environment = {
            **os.environ,
            "ROS_DISTRO": "jazzy",
            "ROS_DOMAIN_ID": str(self.domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": self.discovery,
            "CYCLONEDDS_URI": "<CycloneDDS><Domain><General><Interfaces>"
            '<NetworkInterface name="lo"/></Interfaces></General></Domain></CycloneDDS>',
        }
        with self.log.open("a") as log:
            self.process = subprocess.Popen(
                [self.program, self.config, self.endpoint], env=environment, stdout=log, stderr=log
            )
        until(self.listens, "the bridge to listen")

    def listens(self) -> bool:
        assert self.process is not None
        assert self.process.poll() is None, f"the bridge ended: {self.log.read_text()[-2000:]}"
        with closing(socket.socket()) as probe:
            return probe.connect_ex(("127.0.0.1", self.port)) == 0

    def stop(self) -> None:
        if self.process is not None:
            self.process.terminate()
            self.process.wait(10)


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
    """Starts nodes of ROS 2 itself on rmw_fastrtps, in the bridge's domain; ``NAME=value`` each is
    a setting of their environment."""
    with ExitStack() as stack:

        def start(*settings: str) -> Peer:
            node = [str(built("jazzy")), str(HERE / "ros_node.py"), str(ros_bridge.domain)]
            command = ["env", *settings, *node]
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
    """A router as rmw_zenoh's daemon is one: it listens, forwards, and says nothing itself."""
    endpoint = free_endpoint()
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as session:
        yield Router(endpoint, session)


@pytest.fixture
def start_native_node(router: Router, tmp_path: Path) -> Iterator[Callable[[], Peer]]:
    """Starts nodes as rmw_zenoh's are, in domain 0 of the router: peers that listen on loopback."""
    with ExitStack() as stack:

        def start() -> Peer:
            log = tmp_path / f"native_{time.monotonic_ns()}.log"
            peer = start_peer([str(built("native")), router.endpoint, "0"], log)
            stack.callback(peer.close)
            return peer

        yield start


@pytest.fixture
def native_node(start_native_node: Callable[[], Peer]) -> Peer:
    return start_native_node()


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Callable[..., RealRobot]]:
    """Starts a robot that joins a router, with settings such as ``ros2.rmw_zenoh=true``."""
    robots: list[RealRobot] = []

    def start(endpoint: str, *settings: str) -> RealRobot:
        run = [f'zenoh.connect=["{endpoint}"]', LASER, *settings]
        folder = tmp_path / f"robot{len(robots)}"
        folder.mkdir()
        robots.append(RealRobot(folder, run=[part for each in run for part in ("--set", each)]))
        robots[-1].daemon.says("Connected")
        return robots[-1]

    yield start
    for each in robots:
        each.close()
