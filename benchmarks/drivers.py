"""One interface to the article's bridge and to yahboomd, each on its own simulated polled board."""

from __future__ import annotations

import contextlib
import json
import math
import re
import socket
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple, Protocol

import zenoh

from benchmarks import rig
from yahboomd.simulation.heard import HostBytes, read_heard
from yahboomd.simulation.truth import read_truth

ARTICLE, YAHBOOMD = DRIVERS = ("article", "yahboomd")

SPEED = re.compile(r"\$speed:(-?\d+),(-?\d+),(-?\d+),")
BOARD = ("--dialect", "polled", "--wheel-radius", "0.0325", "--wheel-separation", "0.15")
WHEELS = ("chassis.wheel_radius_m=0.0325", "chassis.wheel_separation_m=0.15")

Pose = tuple[float, float, float]


class Driver(Protocol):
    """The interface of both drivers."""

    def say(self, vx: float, wz: float = 0.0) -> None: ...

    def poses(self) -> list[Pose]: ...

    def account(self) -> str: ...


class ArticleDriver:
    """The bridge behind its socket."""

    def __init__(self, connection: socket.socket, log: Path) -> None:
        self._connection = connection
        self._log = log

    def say(self, vx: float, wz: float = 0.0) -> None:
        """Command a velocity."""
        self._connection.sendall(json.dumps([vx, wz]).encode() + b"\n")

    def poses(self) -> list[Pose]:
        """All poses until now."""
        lines = [json.loads(line) for line in self._log.read_text().splitlines()]
        return [(x, y, theta) for _, x, y, theta in lines]

    def account(self) -> str:
        """Return nothing, because the bridge does not count commands."""
        return ""


class YahboomdDriver:
    """The daemon behind Zenoh."""

    def __init__(self, session: zenoh.Session) -> None:
        self._put = session.declare_publisher(
            "cmd_vel", priority=zenoh.Priority.REAL_TIME, express=True
        ).put
        self._poses: list[Pose] = []
        session.declare_subscriber("yahboomd/pose", self._take)
        self._status = rig.Status(session)
        self._status.ready()

    def _take(self, sample: zenoh.Sample) -> None:
        pose = json.loads(bytes(sample.payload))
        self._poses.append((pose["x"], pose["y"], pose["theta"]))

    def say(self, vx: float, wz: float = 0.0) -> None:
        """Command a velocity."""
        self._put(json.dumps({"vx": vx, "wz": wz}).encode())

    def poses(self) -> list[Pose]:
        """All poses until now."""
        return list(self._poses)

    def account(self) -> str:
        """The daemon's counters of commands."""
        time.sleep(0.6)  # published twice a second
        said = self._status.latest
        link, command = said["link"], said["command"]
        refused = {
            reason: count
            for source in command["sources"].values()
            for reason, count in source.get("refused", {}).items()
        }
        return (
            f"of {command.get('received', 0)} received it refused {refused or 'none'} and replaced "
            f"{link.get('velocities_replaced', 0)} by newer ones before they went out; it lost the "
            f"board {link.get('sessions', 0)} times, and in the end was {said['state']}: "
            f"{said['why']}"
        )


class Trial(NamedTuple):
    """A trial of one driver on one board."""

    driver: Driver
    process: rig.Process
    where: Path

    def control(self, command: str) -> None:
        """Send a command to the board's control socket."""
        with socket.socket(socket.AF_UNIX) as line:
            line.connect(str(self.where / "control"))
            line.sendall(f"{command}\n".encode())
            line.makefile().readline()

    def pose(self) -> Pose:
        """The newest pose."""
        return rig.wait_for(self.driver.poses, "a pose")[-1]

    def heard(self) -> list[HostBytes]:
        """The bytes that the board has received."""
        return read_heard(self.where / "heard")

    def truth(self) -> Pose:
        """The true pose, at most 200 ms old."""
        sample = read_truth(self.where / "truth")[-1]
        return sample.x, sample.y, sample.theta

    def speed(self) -> float:
        """The true speed, at most 200 ms old."""
        return read_truth(self.where / "truth")[-1].vx

    def drive(self, seconds: float, vx: float, wz: float = 0.0) -> None:
        """Command one velocity 20 times a second."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            with contextlib.suppress(OSError):
                self.driver.say(vx, wz)
            time.sleep(0.05)

    def error_m(self, origin: Pose = (0.0, 0.0, 0.0)) -> float:
        """The error of the pose, 1.4 s after a command to stand.

        Args:
            origin: The pose with which it began, facing along x.
        """
        self.drive(1.0, 0.0)
        time.sleep(0.4)
        x, y, _ = self.pose()
        return math.dist((x - origin[0], y - origin[1]), self.truth()[:2])

    def jump_m(self) -> float:
        """The largest step between two poses."""
        poses = self.driver.poses()
        return max((math.dist(a[:2], b[:2]) for a, b in pairwise(poses)),
                   default=0.0)  # fmt: skip


def start_article(stack: contextlib.ExitStack, where: Path) -> tuple[Driver, rig.Process]:
    """Start the rebuilt bridge on the board in a folder."""
    port = rig.free_endpoint().rpartition(":")[2]
    arguments = (str(where / "board"), port, str(where / "poses"))
    process = stack.enter_context(rig.Process("-m", "benchmarks.article", *arguments))
    process.says("ready")
    connection = stack.enter_context(socket.create_connection(("127.0.0.1", int(port))))
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return ArticleDriver(connection, where / "poses"), process


def start_yahboomd(
    stack: contextlib.ExitStack, where: Path, settings: tuple[str, ...]
) -> tuple[Driver, rig.Process]:
    """Start the daemon, commanded over Zenoh."""
    endpoint = rig.free_endpoint()
    process = rig.daemon(where, endpoint, *WHEELS, *settings, port="board")
    stack.enter_context(process)
    return YahboomdDriver(stack.enter_context(rig.client(endpoint))), process


@contextlib.contextmanager
def trial(name: str, *options: str, settings: tuple[str, ...] = ()) -> Iterator[Trial]:
    """Run a board and one of the drivers; ``settings`` are for the daemon."""
    with contextlib.ExitStack() as stack:
        where = stack.enter_context(rig.folder())
        files = [part for each in ("truth", "heard", "control") for part in
                 (f"--{each}", str(where / each))]  # fmt: skip
        link = ("--link", str(where / "board"))
        board = rig.Process("-m", "benchmarks.garbling", *link, *BOARD, *files, *options)
        stack.enter_context(board).says("is at")
        if name == ARTICLE:
            yield Trial(*start_article(stack, where), where)
        else:
            yield Trial(*start_yahboomd(stack, where, settings), where)


def frames(heard: list[HostBytes], since_ns: int = 0) -> list[tuple[int, int, int]]:
    """The time, left and right speed of each speed frame."""
    return [
        (each.t_ns, int(match[1]), int(match[3]))
        for each in heard
        if each.t_ns >= since_ns
        for match in SPEED.finditer(each.data)
    ]
