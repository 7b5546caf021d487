"""The robot as the pages see it: samples encoded once for all of them, services, commands."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from typing import Any

import msgspec
import zenoh

from yahboomd.client.commanding import ENCODING
from yahboomd.client.connection import Connection
from yahboomd.client.move_messages import START
from yahboomd.client.services import Answer, ask, read_answers
from yahboomd.client.streams import MAX_BYTES, STATES, Newest, read_sample, reason
from yahboomd.core.bus import keys
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.options import BusOptions
from yahboomd.core.bus.publishers import BusPublisher
from yahboomd.core.bus.subscriptions import Arrival
from yahboomd.core.clock import Clock
from yahboomd.core.drive.kinematics import KINEMATICS, unit_geometry
from yahboomd.core.messages.codecs import encode
from yahboomd.core.messages.native import (
    BatterySample,
    EstopRequest,
    EventSample,
    PoseSample,
    StatusSample,
    TwistSample,
    VelocityCommand,
    WheelsSample,
)
from yahboomd.core.model import Twist2d
from yahboomd.web.page_commands import PageRefusal
from yahboomd.web.page_session import part, sample_part

LABEL = "the page"

ANSWER_S = 1.5

SAMPLES: dict[str, tuple[str, type[msgspec.Struct]]] = {
    "pose": (keys.POSE, PoseSample),
    "twist": (keys.TWIST, TwistSample),
    "wheels": (keys.WHEELS, WheelsSample),
    "battery": (keys.BATTERY, BatterySample),
}


class RobotFeed:
    """One robot: a session that comes and goes with the daemon, and the facts learned over it.

    Args:
        changed: Called when the daemon comes, goes, or has sent its configuration.

    Attributes:
        known: The latest parts that hold until newer ones come, for a page that connects.
        limits: The fastest that the robot drives; empty while the daemon is not there.
        battery_curve: Charge by volts, as `board.battery_curve`; empty while unknown.
        barred: The reason why the daemon accepts no commands from pages, by its configuration;
            empty if it accepts them, or if this is not known.
        pose: The newest pose; None while none came from this daemon.
    """

    def __init__(
        self,
        options: BusOptions,
        clock: Clock,
        source: str,
        *,
        changed: Callable[[], None],
        happened: Callable[[EventSample], None],
    ) -> None:
        self.known: dict[str, bytes] = {}
        self.limits: dict[str, float] = {}
        self.battery_curve: list[list[float]] = []
        self.barred = ""
        self.pose: PoseSample | None = None
        self.source = source
        self.name = options.namespace
        self._clock = clock
        self._changed = changed
        self._happened = happened
        self._connection = Connection(options, clock, self._presence_changed)
        self._newest: dict[str, Newest] = {}
        self._publisher: BusPublisher | None = None
        self._mover: zenoh.Querier | None = None
        self._shown: StatusSample | None = None
        self._learning: asyncio.Task[None] | None = None
        self._estop: asyncio.Task[Answer] | None = None
        self._next_estop: asyncio.Task[Answer] | None = None

    async def run(self) -> None:
        """Follow the robot until cancelled; wait for a daemon if none is there.

        Raises:
            BusError: The endpoint, the namespace or the file cannot be used.
        """
        connection = self._connection
        await connection.open(math.inf)
        try:
            bus = connection.bus
            self._publisher = bus.publisher(
                self.source, encoding=ENCODING, priority="real_time", express=True
            )
            # It sends no queries, and only shows whether a service would answer.
            self._mover = bus.session.declare_querier(bus.key(START))
            bus.subscribe(keys.EVENTS, self._receive_events, max_bytes=MAX_BYTES)
            self._newest = {kind: Newest(bus, key) for kind, (key, _) in SAMPLES.items()}
            await asyncio.Event().wait()
        finally:
            self._newest = {}
            self._publisher = self._mover = None
            if self._learning is not None:
                self._learning.cancel()
            await connection.close()

    @property
    def alive(self) -> bool:
        """Whether the daemon is there."""
        return self._connection.alive

    @property
    def problem(self) -> str:
        """The reason why no daemon is there; empty while one is."""
        if self.alive:
            return ""
        return self._connection.problem or f"No yahboomd answers at {self._connection.where} yet."

    @property
    def has_moves(self) -> bool:
        """Whether `yahboomd moves` is there."""
        # The stubs call the status a bool, which is what it holds.
        status: object = None if self._mover is None else self._mover.matching_status
        return bool(getattr(status, "matching", status))

    @property
    def bus(self) -> Bus:
        """The open session.

        Raises:
            NoDaemon: No router answered yet.
        """
        return self._connection.bus

    @property
    def state(self) -> str:
        """The daemon's state in a word; empty while it is unknown."""
        status = self._connection.status
        return "" if status is None else status.state

    @property
    def driver(self) -> str | None:
        """The key that has control of the robot."""
        status = self._connection.status
        return None if status is None else status.driver

    def obstacle(self) -> PageRefusal | None:
        """The reason why no page can drive now, if there is one."""
        if not self.alive or self._publisher is None:
            return PageRefusal(why="no_daemon", text=self.problem or "The bus is not open yet.")
        status = self._connection.status
        if status is not None and status.state in {"estopped", "fault"}:
            # The page has a button for the command that releases.
            words = [each.text for each in status.reasons or () if each.kind != "release"]
            return PageRefusal(
                why="estop" if status.state == "estopped" else "fault",
                text=f"The robot cannot drive. {' '.join(words) or status.why}",
            )
        if status is not None and status.state not in STATES:
            return PageRefusal(why="fault", text=f"The robot cannot drive. {reason(status)}")
        if self.barred or not self._publisher.has_subscribers:
            return PageRefusal(why="no_source", text=no_source(self.source))
        return None

    def put(self, twist: Twist2d) -> None:
        """Publish one command; dropped without a bus."""
        if self._publisher is None:
            return
        command = VelocityCommand(
            vx=twist.vx,
            vy=twist.vy,
            wz=twist.wz,
            # The daemon recognises by it a command that is delayed behind this process.
            stamp_ns=self._clock.wall_ns(),
            source=LABEL,
        )
        self._publisher.put(encode(command, "json"))

    def fresh(self) -> dict[str, bytes]:
        """The samples that came since the last call, each as a part of a frame."""
        found: dict[str, bytes] = {}
        for kind, newest in self._newest.items():
            payload = newest.take()
            if payload is None or len(payload) > MAX_BYTES:
                continue
            if (sample := read_sample(payload, SAMPLES[kind][1])) is not None:
                found[kind] = sample_part(kind, sample)
                if isinstance(sample, PoseSample):
                    self.pose = sample
        status = self._connection.status
        if status is not None and status is not self._shown:
            self._shown = status
            found["status"] = sample_part("status", status)
        self.known.update(found)
        return found

    def engage(self) -> asyncio.Task[Answer]:
        """Engage the emergency stop; the task returns the daemon's answer, or that none came.

        At most one query is under way and one waits, for any number of callers: the waiting one is
        sent after all calls that share it. Wait for the task with ``asyncio.shield``.
        """
        if self._next_estop is None:
            self._next_estop = asyncio.create_task(self._ask_estop(self._estop), name="web-estop")
        return self._next_estop

    async def _ask_estop(self, before: asyncio.Task[Answer] | None) -> Answer:
        if before is not None:
            await asyncio.wait([before])
        self._estop, self._next_estop = self._next_estop, None
        payload = encode(EstopRequest(by=LABEL), "json")
        return await self.request(keys.ESTOP, payload, urgent=True)

    async def request(
        self, key: str, payload: bytes = b"{}", *, timeout_s: float = ANSWER_S, urgent: bool = False
    ) -> Answer:
        """Ask a service; return the outcome, also if it refuses."""
        if not self._connection.is_open:
            return Answer(success=False, message=self.problem, answered=0)
        bus = self._connection.bus
        return read_answers(
            await ask(bus.session, bus.key(key), payload, timeout_s=timeout_s, urgent=urgent)
        )

    def _presence_changed(self, alive: bool) -> None:
        self.known.clear()
        self.limits = {}
        self.battery_curve = []
        self.barred = ""
        self._shown = self.pose = None
        if self._learning is not None:
            self._learning.cancel()
            self._learning = None
        if alive:
            self._learning = asyncio.create_task(self._learn(), name="web-learn")
        self._changed()

    async def _learn(self) -> None:
        while True:
            answer = await self.request(keys.CONFIG)
            if answer.answered:
                break
            # Ask again: without limits no page drives, and a busy machine may answer late.
            await asyncio.sleep(ANSWER_S)
        if answer.success:
            self.limits = limits_of(answer.data)
            self.battery_curve = curve_of(answer.data)
            self.barred = "" if takes(answer.data, self.source) else no_source(self.source)
            self._changed()

    def _receive_events(self, arrivals: list[Arrival]) -> None:
        for arrival in arrivals:
            if (event := read_sample(arrival.payload, EventSample)) is not None:
                self._happened(event)


class _Limit(msgspec.Struct):
    velocity: float


class _Limits(msgspec.Struct):
    linear: _Limit
    angular: _Limit


class _Chassis(msgspec.Struct):
    kinematics: str


class _InEffect(msgspec.Struct):
    """The part of the configuration that pages need: its own models would take 13 MB."""

    limits: _Limits
    chassis: _Chassis


class _Board(msgspec.Struct):
    battery_curve: list[list[float]]


class _Battery(msgspec.Struct):
    board: _Board


def limits_of(config: dict[str, Any]) -> dict[str, float]:
    """The robot's speed limits, by its configuration in effect; empty if unknown."""
    try:
        known = msgspec.convert(config, _InEffect)
    except msgspec.ValidationError:
        # The configuration of another version.
        return {}
    linear, kinematics = known.limits.linear.velocity, known.chassis.kinematics
    # Another version may know more kinds of bases.
    sideways = kinematics in KINEMATICS and unit_geometry(kinematics).holonomic
    return {
        "vx": linear,
        "vy": linear if sideways else 0.0,
        "wz": known.limits.angular.velocity,
    }


def curve_of(config: dict[str, Any]) -> list[list[float]]:
    """The battery's points (volts, charge from 0 to 1) by a configuration; empty if unknown."""
    try:
        return msgspec.convert(config, _Battery).board.battery_curve
    except msgspec.ValidationError:
        return []


def takes(config: dict[str, Any], source: str) -> bool:
    """Whether a daemon with this configuration accepts commands on a key, or may accept them."""
    command = config.get("command")
    sources = command.get("sources") if isinstance(command, dict) else None
    return not isinstance(sources, dict) or source in sources


def no_source(source: str) -> str:
    """The words for a daemon that does not know a key of commands."""
    return (
        f"The robot takes no commands from pages: its configuration has no source {source}. "
        "The manual's page on phones tells how to add it."
    )


def daemon_part(feed: RobotFeed) -> bytes:
    """Whether the daemon is there, for pages."""
    return part("daemon", alive=feed.alive, text=feed.problem)
