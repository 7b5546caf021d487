"""The process `yahboomd moves`: the keeper on the bus, as a client of the daemon."""

from __future__ import annotations

import asyncio
import math
import re
import secrets
from collections.abc import Awaitable, Callable
from typing import TypeVar

import msgspec

from yahboomd.client.async_robot import AsyncRobot
from yahboomd.client.move_messages import (
    BEAT,
    CANCEL,
    HOLDER,
    MOST_BYTES,
    MOVES,
    PAUSE,
    RESUME,
    SOURCE,
    START,
    MoveBeat,
    MoveChoice,
    MoveRequest,
    MoveSample,
)
from yahboomd.client.streams import read_sample
from yahboomd.core.bus import keys
from yahboomd.core.bus.options import BusOptions
from yahboomd.core.bus.presence import TokenChange
from yahboomd.core.bus.publishers import BusPublisher
from yahboomd.core.bus.services import BusQuery, Response
from yahboomd.core.bus.subscriptions import Arrival
from yahboomd.core.clock import Clock, nanoseconds
from yahboomd.core.errors import NoDaemon, Refused
from yahboomd.core.messages.codecs import NativeEncoding, encode, encoding_name, encoding_of
from yahboomd.core.messages.native import (
    EventSample,
    ImuSample,
    PoseSample,
    ServiceReply,
    StatusSample,
    TwistSample,
)
from yahboomd.core.model import Twist2d
from yahboomd.moves.move_keeper import MoveKeeper

CHECK_S = 0.05
REPORT_EVERY = 2
"""The progress is published at every second check: ten times a second."""

DEADMAN_S = 0.25
"""How long a velocity lasts without the next one: longer than a short gap of poses."""

CONFIG_S = 1.0

SERVING = f"{MOVES}/serving"
"""Below it each service has a liveliness token. The lowest name serves: ``0`` begins that of a
service that serves already, ``1`` that of one that looks for others. No clock decides: clocks step.
"""

SETTLE_S = 0.5
"""How long a service looks for others, from when it hears the daemon, before it serves."""

Request = TypeVar("Request", bound=msgspec.Struct)


class MoveService:
    """Drives the moves of one robot.

    Args:
        options: The connection to the daemon.
        clock: The source of time.
    """

    def __init__(self, options: BusOptions, clock: Clock) -> None:
        self._clock = clock
        self.robot = AsyncRobot(
            options,
            source=SOURCE,
            label="yahboomd moves",
            deadman_s=DEADMAN_S,
            wait_s=math.inf,
            clock=clock,
        )
        self._keeper = MoveKeeper(
            drive=self._drive,
            stop=self.robot.stop,
            publish=self._publish,
            name=lambda: secrets.token_hex(4),
        )
        self._publisher: BusPublisher | None = None
        self._learning: asyncio.Task[None] | None = None
        self._alive = False
        self.serving = False
        """Whether it answers clients: no other service does."""
        self._nonce = secrets.token_hex(8)
        self._name = f"1-{self._nonce}"
        self._services = set[str]()
        self._settled_ns: int | None = None

    async def run(self) -> None:
        """Serve until cancelled; then stop the robot if it was driven.

        Raises:
            BusError: The options cannot be used.
            Refused: Another service was there before: two of them would both drive each move.
        """
        await self.robot.join(math.inf)
        try:
            self._declare()
            checks = 0
            while True:
                await asyncio.sleep(CHECK_S)
                checks += 1
                self._look_for_daemon()
                self._look_for_others(self._clock.now_ns())
                self._keeper.check(self._clock.now_ns())
                if checks % REPORT_EVERY == 0:
                    self._keeper.report()
        finally:
            self._keeper.end("service_ended", "`yahboomd moves` was stopped.")
            if self._learning is not None:
                self._learning.cancel()
            await self.robot.close()

    def _declare(self) -> None:
        robot, keeper, now = self.robot, self._keeper, self._clock.now_ns
        bus = robot.bus
        self._publisher = bus.publisher(MOVES, encoding=encoding_name(MoveSample, "json"))
        robot.on(StatusSample, lambda status: keeper.status(status, now()), depth=16)
        robot.on(EventSample, keeper.event)
        robot.on(TwistSample, keeper.twist)
        robot.on(ImuSample, lambda sample: keeper.imu(sample, now()))
        robot.on(PoseSample, lambda pose: keeper.pose(pose, now()))
        bus.subscribe(BEAT, self._beat, depth=64)
        bus.watch_tokens(f"{HOLDER}/*", self._tokens)
        bus.watch_tokens(f"{SERVING}/*", self._others)
        bus.token(f"{SERVING}/{self._name}")

    def _begin_serving(self) -> None:
        bus = self.robot.bus
        self.serving, self._name = True, f"0-{self._nonce}"
        bus.token(f"{SERVING}/{self._name}")
        self._serve(START, self._start)
        self._serve(CANCEL, self._choosing("cancel"))
        self._serve(PAUSE, self._choosing("pause"))
        self._serve(RESUME, self._choosing("resume"))
        bus.serve(MOVES, self._newest, fallback=_refused, wildcards=True)

    def _serve(
        self, key: str, handler: Callable[[BusQuery], Response | Awaitable[Response]]
    ) -> None:
        self.robot.bus.serve(key, handler, fallback=_refused, max_bytes=MOST_BYTES)

    # The daemon.

    def _look_for_daemon(self) -> None:
        alive = self.robot.alive
        if alive != self._alive:
            self._alive = alive
            if not alive:
                self._keeper.lost()
        asks = self._learning is not None and not self._learning.done()
        if alive and not self._keeper.knows_base and not asks:
            self._learning = asyncio.create_task(self._learn(), name="moves-learn")

    def _look_for_others(self, now_ns: int) -> None:
        if not self.serving:
            if not self._alive:
                self._settled_ns = None
                return
            if self._settled_ns is None:
                self._settled_ns = now_ns + nanoseconds(SETTLE_S)
            if now_ns < self._settled_ns:
                return
        if any(name < self._name for name in self._services):
            raise Refused(
                "Another `yahboomd moves` serves this robot already, and two would both drive each "
                "move.",
                remedy="Use that one, or end it first: `systemctl stop yahboomd-moves`, or Ctrl-C "
                "where it runs.",
            )
        if not self.serving:
            self._begin_serving()

    async def _learn(self) -> None:
        try:
            self._keeper.learn((await self.robot.call(keys.CONFIG, timeout_s=CONFIG_S)).data)
        except (NoDaemon, Refused):
            # Asked again while the daemon is there.
            return

    def _drive(self, twist: Twist2d) -> None:
        self.robot.drive(twist.vx, twist.wz, vy=twist.vy)

    def _publish(self, sample: MoveSample) -> None:
        if self._publisher is not None:
            stamped = msgspec.structs.replace(sample, stamp_ns=self._clock.wall_ns())
            self._keeper.last = stamped
            self._publisher.put(encode(stamped, "json"))

    # Clients.

    def _beat(self, arrivals: list[Arrival]) -> None:
        for arrival in arrivals:
            if arrival.dropped:
                self._keeper.beats_lost(arrival.arrived_ns)
            beat = read_sample(arrival.payload, MoveBeat)
            if beat is not None:
                self._keeper.beat(beat.id, arrival.arrived_ns)

    def _tokens(self, changes: list[TokenChange]) -> None:
        for change in changes:
            self._keeper.holder(change.key.rpartition("/")[2], present=change.present)

    def _others(self, changes: list[TokenChange]) -> None:
        for change in changes:
            name = change.key.rpartition("/")[2]
            if not re.fullmatch("[01]-[0-9a-f]{16}", name):
                # No service has such a name: a token of another program ends none.
                continue
            (self._services.add if change.present else self._services.discard)(name)

    async def _start(self, query: BusQuery) -> Response:
        request = _read(query, MoveRequest)
        if isinstance(request, str):
            return _answer(query, ServiceReply(success=False, message=request))
        if self.robot.alive and not self._keeper.knows_base:
            await self._learn()
        return _answer(query, self._keeper.start(request, self._clock.now_ns()))

    def _choosing(self, verb: str) -> Callable[[BusQuery], Response]:
        def choose(query: BusQuery) -> Response:
            choice: MoveChoice | str = MoveChoice()
            if query.payload:
                choice = _read(query, MoveChoice)
            if isinstance(choice, str):
                return _answer(query, ServiceReply(success=False, message=choice))
            return _answer(query, self._keeper.choose(verb, choice.id))

        return choose

    def _newest(self, query: BusQuery) -> Response:
        if self._keeper.last is None:
            return _refused("No moves were driven yet.", query)
        return Response(
            payload=encode(self._keeper.last, "json"), encoding=encoding_name(MoveSample, "json")
        )


def _read(query: BusQuery, message: type[Request]) -> Request | str:
    """The request, or its problem in words."""
    encoding = encoding_of(query.payload)
    if encoding not in {"json", "msgpack"}:
        return "The request is neither JSON nor MessagePack."
    try:
        if encoding == "json":
            return msgspec.json.decode(query.payload, type=message)
        return msgspec.msgpack.decode(query.payload, type=message)
    except (ValueError, RecursionError, OverflowError) as error:
        return f"The request cannot be read: {error}."


def _answer(query: BusQuery, reply: ServiceReply) -> Response:
    """The answer in the encoding of the question."""
    asked = encoding_of(query.payload or query.head)
    encoding: NativeEncoding = "msgpack" if asked == "msgpack" else "json"
    return Response(payload=encode(reply, encoding), encoding=encoding_name(ServiceReply, encoding))


def _refused(reason: str, query: BusQuery) -> Response:
    return _answer(query, ServiceReply(success=False, message=reason))
