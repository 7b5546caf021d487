"""Real peers of ROS 2 for tests: built once into a cache, started here, ended by their handles."""

from __future__ import annotations

import json
import os
import random
import re
import signal
import socket
import subprocess
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from zenoh_fixtures import free_endpoint

HERE = Path(__file__).parent
EXAMPLE = HERE.parents[1] / "examples" / "zenoh-bridge-ros2dds.json5"
CACHE = (
    Path(
        os.environ.get("YAHBOOMD_CACHE")
        or Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "yahboomd"
    )
    / "interop"
)
DISTROS = ("jazzy", "kilted")
"""The distributions of ROS 2 that can be had as wheels."""
ENVIRONMENTS = ("venv", "sdk", "rosbridge", "bringup", *(f"ros-{distro}" for distro in DISTROS))
PATIENCE_S = 60.0
"""The time that a condition may take: DDS discovery needs a second or two, a busy machine more."""

LASER = 'ros2.static_transforms=[{parent="base_link",child="laser",x=0.1,yaw=1.5707963267948966}]'

ON_LOOPBACK = (
    '<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="lo"/></Interfaces></General>'
    "</Domain></CycloneDDS>"
)
"""The setting of Cyclone DDS with which nodes of FastDDS find it, as docs/ros2.md has it."""

Event = dict[str, Any]


def built(name: str) -> Path:
    """The program or environment `name` from the cache, or a skip that explains how to get it."""
    path = CACHE / (f"{name}/bin/python" if name in ENVIRONMENTS else f"bin/current/{name}")
    if not path.exists():
        pytest.skip(f"{name} is not built: `make interop` builds it ({path} is missing)")
    return path


_RESERVED: deque[socket.socket] = deque()


def free_domain() -> int:
    """A DDS domain whose ports are free, and that no other test of this machine gets."""
    # Its ports are fixed, 250 to a domain from 7400 on; above 100 they are the system's own.
    for domain in random.SystemRandom().sample(range(1, 101), 100):
        reserved = socket.socket(socket.AF_UNIX)
        try:
            # An abstract name: the kernel gives it to one process, until that closes it or ends.
            reserved.bind(f"\0yahboomd test domain {domain}")
            with ExitStack() as stack:
                for port in (7400, 7410, 7411, 7412, 7413):
                    probe = stack.enter_context(socket.socket(type=socket.SOCK_DGRAM))
                    probe.bind(("127.0.0.1", port + 250 * domain))
        except OSError:
            reserved.close()
            continue
        _RESERVED.append(reserved)
        if len(_RESERVED) > 4:
            _RESERVED.popleft().close()
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
            # One that is ended in the middle of a line leaves a part of it, and rmw_zenoh's library
            # warns here too.
            if line.startswith("{") and line.endswith("\n"):
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

    def close(self, patience_s: float = 10.0) -> None:
        assert self.process.stdin is not None
        with suppress(BrokenPipeError):
            self.process.stdin.close()
        with suppress(subprocess.TimeoutExpired):
            self.process.wait(patience_s)
        # Also what it started: a process that goes on keeps the pipe open.
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        self.reader.join()
        assert self.process.stdout is not None
        self.process.stdout.close()


def ros_node(distro: str, domain: int, *consumers: str) -> list[str]:
    """The command of a node of ROS 2 itself, or a skip that names the missing part.

    Args:
        distro: Its distribution.
        domain: Its ROS_DOMAIN_ID.
        consumers: The programs as which it subscribes (`ros_node.py`).
    """
    python = built(f"ros-{distro}")
    if "tf2_ros" in consumers and not (python.parents[1] / "share/tf2_msgs/package.xml").exists():
        pytest.skip(f"tf2_msgs of {distro} is not built: it takes cmake and a C compiler")
    return [str(python), str(HERE / "ros_node.py"), str(domain), *consumers]


def sdk(endpoint: str, name: str) -> list[str]:
    """The command of a node of zenoh-ros2-sdk in domain 0 of what listens at an endpoint."""
    return [str(built("sdk")), str(HERE / "sdk_node.py"), endpoint, "0", name]


def hears(listener: Peer, talker: Peer, text: str) -> None:
    """The one hears what the other says, if it says it often enough to be found."""

    def said(event: Event) -> bool:
        message = event.get("message")
        text_of_it = message["data"] if isinstance(message, dict) else message
        return event.get("topic") == "/chatter" and text_of_it == text

    def found() -> bool:
        talker.order("talk", text=text)
        return any(map(said, list(listener.events)))

    until(found, f"{text} to be heard")


def start_peer(command: list[str], log: Path, environ: dict[str, str] | None = None) -> Peer:
    with log.open("w") as stderr:
        process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=stderr, text=True,
            env=environ, start_new_session=True,
        )  # fmt: skip
    peer = Peer(process, log)
    peer.await_event(lambda e: e["event"] == "ready", f"{command[0]} to be ready")
    return peer


def example_for(names: str, path: Path) -> Path:
    """The example's configuration for robots whose names fit an expression, such as ``bot.``."""
    path.write_text(re.sub(r'"(/[\w/]+)"(?=[],])', rf'"/{names}\1"', EXAMPLE.read_text()))
    return path


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
            "CYCLONEDDS_URI": ON_LOOPBACK,
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
            self.process.wait(PATIENCE_S)
