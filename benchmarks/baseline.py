"""The article's bridge and yahboomd through the same trials on the same simulated polled board.

The bridge is written anew from the article's description, with its ROS calls replaced by nothing
(a socket on loopback brings its velocities; see ``benchmarks/article.py``). Both drive the board
of ``yahboomd simulate --dialect polled`` on a pty, paced at 115200 baud, one after the other; the
truth is the simulator's, and so are the stamps of what is heard on the wire. Both are told the
simulated robot's wheels. The pose is compared with the truth at the end of each trial.
"""

from __future__ import annotations

import contextlib
import json
import math
import random
import re
import socket
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple, Protocol

import zenoh

from benchmarks import rig
from benchmarks.latency import UNLIMITED
from benchmarks.report import Section, milliseconds, number, quantile
from yahboomd.simulation.heard import Heard, read_heard
from yahboomd.simulation.truth import read_truth

SPEED = re.compile(r"\$speed:(-?\d+),(-?\d+),(-?\d+),")
BOARD = ("--dialect", "polled", "--wheel-radius", "0.0325", "--wheel-separation", "0.15")
WHEELS = ("chassis.wheel_radius_m=0.0325", "chassis.wheel_separation_m=0.15")

Pose = tuple[float, float, float]


class Driver(Protocol):
    """What a trial knows of either."""

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
        """All poses so far."""
        lines = [json.loads(line) for line in self._log.read_text().splitlines()]
        return [(x, y, theta) for _, x, y, theta in lines]

    def account(self) -> str:
        """It keeps none."""
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
        """All poses so far."""
        return list(self._poses)

    def account(self) -> str:
        """What became of the commands, by the daemon's own counters."""
        time.sleep(0.6)  # it tells twice a second
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
    """One board, one driver."""

    driver: Driver
    where: Path
    process: rig.Process

    def control(self, command: str) -> None:
        """Disturb the board."""
        with socket.socket(socket.AF_UNIX) as line:
            line.connect(str(self.where / "control"))
            line.sendall(f"{command}\n".encode())
            line.makefile().readline()

    def heard(self) -> list[Heard]:
        """What the board heard so far."""
        return read_heard(self.where / "heard")

    def truth(self) -> Pose:
        """Where the robot truly is, at most 200 ms ago."""
        sample = read_truth(self.where / "truth")[-1]
        return sample.x, sample.y, sample.theta

    def speed(self) -> float:
        """The true speed, at most 200 ms ago."""
        return read_truth(self.where / "truth")[-1].vx

    def drive(self, seconds: float, vx: float, wz: float = 0.0) -> None:
        """Say one velocity 20 times a second."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            with contextlib.suppress(OSError):
                self.driver.say(vx, wz)
            time.sleep(0.05)

    def error_m(self) -> float:
        """How far the pose is from the truth, once the robot stands."""
        self.drive(1.0, 0.0)
        time.sleep(0.4)
        poses = self.driver.poses()
        return math.dist(poses[-1][:2], self.truth()[:2]) if poses else math.nan

    def jump_m(self) -> float:
        """The largest step between two poses."""
        poses = self.driver.poses()
        return max((math.dist(a[:2], b[:2]) for a, b in pairwise(poses)),
                   default=0.0)  # fmt: skip


@contextlib.contextmanager
def trial(name: str, *options: str, settings: tuple[str, ...] = ()) -> Iterator[Trial]:
    """A board and one of the two drivers; the settings are the daemon's."""
    with contextlib.ExitStack() as stack:
        where = stack.enter_context(rig.folder())
        files = [part for each in ("truth", "heard", "control") for part in
                 (f"--{each}", str(where / each))]  # fmt: skip
        stack.enter_context(rig.simulator(where, *BOARD, *files, *options))
        endpoint = rig.free_endpoint()
        port = endpoint.rpartition(":")[2]
        driver: Driver
        if name == "article":
            arguments = (str(where / "board"), port, str(where / "poses"))
            process = rig.Process("-m", "benchmarks.article", *arguments)
            stack.enter_context(process).says("ready")
            connection = stack.enter_context(socket.create_connection(("127.0.0.1", int(port))))
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            driver = ArticleDriver(connection, where / "poses")
        else:
            process = rig.daemon(where, endpoint, *WHEELS, *settings, port="board")
            stack.enter_context(process)
            driver = YahboomdDriver(stack.enter_context(rig.client(endpoint)))
        yield Trial(driver, where, process)


def frames(heard: list[Heard], since_ns: int = 0) -> list[tuple[int, int, int]]:
    """(when, left, right) of the speed frames."""
    return [
        (each.t_ns, int(match[1]), int(match[3]))
        for each in heard
        if each.t_ns >= since_ns
        for match in SPEED.finditer(each.data)
    ]


Figures = dict[str, str]


def polling_and_latency(name: str, count: int, figures: Figures) -> str:
    """Polls in five seconds or so, and from the command to the frame.

    Returns:
        What became of commands that never reached the wire, as far as it is known.
    """
    chance = random.Random(3)
    sent: list[tuple[int, int]] = []
    # The bridge has no limits of acceleration, under which one command becomes several frames.
    with trial(name, settings=UNLIMITED) as run:
        run.drive(0.5, 0.2)
        begin_ns = time.monotonic_ns()
        for n in range(count):
            units = 300 + n % 100
            # Half a unit more: the bridge cuts decimals off.
            sent.append((time.monotonic_ns(), units))
            run.driver.say((units + 0.4) / 1000.0)
            time.sleep(chance.uniform(0.03, 0.07))
        end_ns = time.monotonic_ns()
        run.drive(0.3, 0.0)
        heard = run.heard()
        account = run.driver.account()
        faults = [line for line in run.process.lines if "ERROR" in line]
    polls = sum(each.data.count("$read#") for each in heard if begin_ns <= each.t_ns < end_ns)
    figures["polls a second"] = number(polls / (end_ns - begin_ns) * 1e9)
    latencies = []
    lost = 0
    found = frames(heard, begin_ns)
    for sent_ns, units in sent:
        match = next((t for t, left, _ in found if t >= sent_ns and left == units), None)
        if match is None or match - sent_ns > 1_000_000_000:
            lost += 1
        else:
            latencies.append(match - sent_ns)
    for share in (0.5, 0.99):
        figures[f"command to wire, p{share * 100:.0f}, ms"] = milliseconds(
            quantile(latencies, share)
        )
    figures["command to wire, worst, ms"] = milliseconds(max(latencies, default=math.nan))
    figures["commands that never reached the wire as they were"] = f"{lost} of {count}"
    for fault in faults:
        print(name, "said:", fault, flush=True)
    return f"{name}: {account}" if lost and account else ""


def at_start(name: str, figures: Figures) -> None:
    """Counters that are not zero."""
    with trial(name, "--ticks", "123456,0,120000,0") as run:
        time.sleep(1.0)
        poses = run.driver.poses()
        figures["start with counters at 123456 and 120000: pose, m from the origin"] = number(
            math.hypot(*poses[-1][:2])
        )
        figures["the same: heading, degrees"] = number(math.degrees(poses[-1][2]))


def plain_drive(name: str, figures: Figures) -> None:
    """A few seconds of curves without any fault."""
    with trial(name) as run:
        for wz in (0.0, 1.5, -1.5, 3.0):
            run.drive(2.0, 0.4, wz)
        figures["3 m of curves, no fault: pose off by, m"] = number(run.error_m())


def reset(name: str, figures: Figures) -> None:
    """The board resets itself in motion."""
    with trial(name) as run:
        run.drive(3.0, 0.3)
        run.control("reset")
        run.drive(3.0, 0.3)
        figures["reset in motion: drives again within 3 s"] = (
            "yes" if abs(run.speed()) > 0.2 else "no"
        )
        figures["reset in motion: pose off by, m"] = number(run.error_m())
        figures["reset in motion: largest step of the pose, m"] = number(run.jump_m())


def garbled(name: str, seconds: float, figures: Figures) -> None:
    """One byte in five hundred has a bit flipped."""
    with trial(name, "--seed", "5") as run:
        run.drive(1.0, 0.3)
        run.control("corruption 0.002")
        run.drive(seconds, 0.3, 0.5)
        run.control("clear")
        figures["0.2 % of bytes garbled: pose off by, m"] = number(run.error_m())
        figures["0.2 % of bytes garbled: largest step of the pose, m"] = number(run.jump_m())


def saturation(name: str, figures: Figures) -> None:
    """More than the wheels can do: 0.9 m/s and 4 rad/s ask 1.2 m/s of the right wheel."""
    with trial(name) as run:
        run.drive(1.5, 0.9, 4.0)
        _, left, right = frames(run.heard())[-1]
    wanted = 4.0 / 0.9
    told = (right - left) / 1000.0 / 0.15 / ((left + right) / 2000.0)
    figures["0.9 m/s with 4 rad/s: frame on the wire"] = f"left {left}, right {right}"
    figures["the same: curvature off by, %"] = number(abs(told / wanted - 1.0) * 100.0)


def unplug(name: str, figures: Figures) -> None:
    """The plug is out for two seconds."""
    with trial(name) as run:
        run.drive(1.5, 0.3)
        run.control("unplug 2")
        back_ns = time.monotonic_ns() + 2_000_000_000
        run.drive(5.0, 0.3)
        after = [t_ns for t_ns, *_ in frames(run.heard(), back_ns)]
        figures["unplugged for 2 s: first speed frame after the plug is back, s"] = (
            number((after[0] - back_ns) / 1e9) if after else "never"
        )


def silence(name: str, figures: Figures) -> None:
    """The application falls silent in motion."""
    with trial(name) as run:
        run.drive(1.5, 0.3)
        silent_ns = time.monotonic_ns()
        time.sleep(3.0)
        stops = [t_ns for t_ns, left, right in frames(run.heard(), silent_ns) if left == right == 0]
        figures["commands end in motion: first stop on the wire after, s"] = (
            number((stops[0] - silent_ns) / 1e9) if stops else "never (3 s watched)"
        )
        figures["commands end in motion: speed 3 s later, m/s"] = number(run.speed())


def bench(*, short: bool, images: Path) -> Section:  # noqa: ARG001 - it has none
    """The section."""
    section = Section(
        name="baseline",
        title="Beside the article's bridge",
        how=__doc__.split("\n\n", 1)[1].replace("\n", " "),
    )
    columns: dict[str, Figures] = {}
    accounts = []
    for name in ("article", "yahboomd"):
        figures = columns[name] = {}
        accounts.append(polling_and_latency(name, 10 if short else 1000, figures))
        at_start(name, figures)
        saturation(name, figures)
        if not short:
            plain_drive(name, figures)
            reset(name, figures)
            garbled(name, 20.0, figures)
            unplug(name, figures)
            silence(name, figures)
    article, ours = columns["article"], columns["yahboomd"]
    section.table(
        "The same trials, in the article's bridge and in yahboomd.",
        ["trial", "the article's bridge", "yahboomd"],
        [[row, article[row], ours[row]] for row in article],
    )
    p50 = "command to wire, p50, ms"
    section.findings.append(
        f"A command is on the wire {number(float(article[p50]) / float(ours[p50]))} times sooner "
        "at the median, although the bridge's come over a bare socket and yahboomd's over Zenoh."
    )
    section.findings += [
        f"Commands that never reached the wire, {each}" for each in accounts if each
    ]
    return section
