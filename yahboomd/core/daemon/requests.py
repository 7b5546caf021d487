"""The services and the e-stop: their actions, their answers, and their declarations."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterable, Mapping
from functools import partial
from typing import Any

import msgspec

from yahboomd import __version__
from yahboomd.core.bus import keys
from yahboomd.core.bus.alarms import READ_BYTES
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.presence import Neighbour, senders
from yahboomd.core.bus.services import TOO_MANY, BusQuery, Response
from yahboomd.core.clock import Clock
from yahboomd.core.daemon.control import Controller
from yahboomd.core.daemon.estop.latch import EstopLatch
from yahboomd.core.drive.arbiter import Arbiter
from yahboomd.core.messages.codecs import (
    Encoding,
    NativeEncoding,
    Refusal,
    decode_set_pose,
    encode_reply,
    encoding_name,
    encoding_of,
    estop_by,
    is_not_pressed,
    is_release_attempt,
)
from yahboomd.core.messages.codecs import encode as encode_sample
from yahboomd.core.messages.native import ServiceReply
from yahboomd.core.model import Event, Matrix3, Pose2d

COPIES_NS = 1_000_000_000
"""Copies of one request (the ROS 2 bridge may make them) come within this time, mostly at once."""

SET_POSE_TAKES = (
    'It takes x and y in metres and theta in radians, such as {"x": 1.0, "y": 2.0, "theta": 0.5}.'
)


class Operator:
    """Carries out requests, and returns the results in words."""

    def __init__(
        self, clock: Clock, *, controller: Controller, arbiter: Arbiter, latch: EstopLatch
    ) -> None:
        self._clock = clock
        self._controller = controller
        self._arbiter = arbiter
        self._latch = latch
        self._released_ns: int | None = None

    def engage_estop(self, by: str, *, times: int = 1, unread: int = 0) -> str:
        """Engage the emergency stop; return a sentence for :meth:`acknowledged`.

        Args:
            times: The number of requests since the last call.
            unread: The number of those that were too long to be read.
        """
        controller = self._controller
        news = self._latch.engage(by, self._clock.now_ns())
        how = " that was too long to be read" if unread else ""
        words = f"Emergency stop engaged by {by}{how}."
        event = Event(kind="estop", severity="warning", message=words) if news else None
        # The wheels first, then the disk, then the words.
        controller.stop_now(event)
        controller.counters["estops"] += times
        controller.counters["estops_unread"] += unread
        self._latch.remember()
        return words if news else "The emergency stop was engaged already."

    async def acknowledged(self, words: str) -> ServiceReply:
        """The answer to an e-stop, once it was sent and is on file; within half a second.

        Args:
            words: The result of :meth:`engage_estop`.

        Returns:
            ``success``: it was sent. The message lists what failed.
        """
        problem, on_file = await asyncio.gather(
            self._controller.stop_reports.sent(), self._latch.on_file()
        )
        stands, fastest_m_s = (None, None) if problem else self._controller.wheels_seen()
        sentences = [words, problem] if problem else [words]
        if not on_file:
            sentences.append("It is not on file yet, and would not survive a restart.")
        data = {"sent": not problem, "stands": stands, "fastest_m_s": fastest_m_s}
        return ServiceReply(success=not problem, message=" ".join(sentences), data=data)

    def refuse_release(self, by: str, *, times: int = 1) -> str:
        """Count refused attempts to release the e-stop; return a sentence for them.

        Args:
            times: Their number since the last call.
        """
        self._controller.counters["release_refused"] += times
        words = (
            f"Not released by {by}: the service yahboomd/estop/reset releases the emergency stop."
        )
        self._controller.event(
            Event(kind="estop_release_refused", severity="warning", message=words)
        )
        return words

    def count_not_pressed(self, times: int) -> None:
        """Count samples of an e-stop that is not pressed; they change nothing."""
        self._controller.counters["estop_not_pressed"] += times

    def release_estop(self) -> tuple[bool, str]:
        """Release the e-stop, and clear a latched fault with it, unless a source commands motion.

        An e-stop that was engaged within a second of the last release stays: this may be a copy of
        that request.

        Returns:
            Whether the robot may move again, and a sentence.
        """
        controller = self._controller
        was_engaged = self._latch.engaged
        # Commands that waited with this request may be handled after it.
        controller.notice_pause()
        now_ns = self._clock.now_ns()
        released_ns = self._released_ns
        if was_engaged and released_ns is not None and now_ns - released_ns < COPIES_NS:
            controller.counters["release_refused"] += 1
            words = (
                "Still engaged: it was engaged within a second of the last release, and this may "
                "be a copy of that request. Wait a second, then release it again."
            )
            return False, words
        moving = self._arbiter.moving_sources(now_ns)
        if moving and controller.fault and not was_engaged:
            controller.counters["release_refused"] += 1
            words = (
                f"The fault stays: {', '.join(moving)} commands motion, or did within the last "
                "second. Let go of the controls, wait a second, then clear it again."
            )
            return False, words
        release = self._latch.release(moving)
        if not release.released:
            controller.counters["release_refused"] += 1
            return False, release.message
        fault = controller.clear_fault()
        if fault is None:
            words = release.message if was_engaged else "Nothing to release: no e-stop, no fault."
        else:
            # Its remedy is done; the first sentence has the fault itself.
            cleared = f"Cleared the fault: {fault.partition('. ')[0].removesuffix('.')}."
            words = f"{release.message} {cleared}" if was_engaged else cleared
        if was_engaged or fault is not None:
            # Commands that arrived while the disk was busy are discarded, like all before them.
            self._released_ns = self._clock.now_ns()
            self._arbiter.forget_commands(self._released_ns)
            controller.event(Event(kind="estop_released", severity="info", message=words))
        return True, words

    def set_pose(self, pose: Pose2d, covariance: Matrix3 | None) -> str:
        self._controller.set_pose(pose, covariance)
        words = f"The pose is x {pose.x:g} m, y {pose.y:g} m, theta {pose.theta:g} rad."
        self._controller.event(Event(kind="pose_set", severity="info", message=words))
        return words

    def refuse_pose(self, problem: str) -> None:
        self._controller.counters["poses_refused"] += 1
        words = f"A pose was not set: {problem}."
        self._controller.event(Event(kind="pose_refused", severity="warning", message=words))


Facts = Callable[[], dict[str, Any]]
Newest = Callable[[str], msgspec.Struct | None]
Action = Callable[[BusQuery], ServiceReply]
"""Carries out a request, and returns the result."""
Answer = Callable[[BusQuery, ServiceReply], Response]
"""Encodes the result of a request."""


class Services:
    """Answers queries, and receives the e-stop.

    Args:
        encoding: The encoding of answers to requests without a recognisable payload.
        newest: The newest sample of a key that is published.
        save_box: Saves the black box, and returns the result.
    """

    def __init__(
        self,
        operator: Operator,
        *,
        encoding: NativeEncoding,
        config: Facts,
        board: Facts,
        newest: Newest,
        save_box: Callable[[], Awaitable[ServiceReply]],
    ) -> None:
        self.operator = operator
        self._encoding: NativeEncoding = encoding
        self._config = config
        self._board = board
        self._newest = newest
        self._save_box = save_box
        self._neighbours: Callable[[], tuple[Neighbour, ...]] = tuple
        self.actions: dict[str, Action] = {
            keys.ESTOP: self._estop_query,
            keys.ESTOP_RESET: self._estop_reset,
            keys.ODOMETRY_RESET: self._odometry_reset,
            keys.ODOMETRY_SET_POSE: self._set_pose,
            keys.CONFIG: self._answer_config,
            keys.BOARD: self._answer_board,
        }
        """The handler of each service, by its key; the e-stop first."""

    def serve(self, bus: Bus, groups: Iterable[str] = ()) -> None:
        """Declare everything on an open session; the e-stop first, also that of ``groups``."""
        self._neighbours = lambda: bus.neighbours
        self.hear_estop(bus, keys.ESTOP)
        for at in (f"/{keys.full_key(group, keys.ESTOP)}" for group in groups):
            self.hear_estop(bus, at)
            self.offer(bus, keys.ESTOP, self._estop_query, at=at)
        for key, action in self.actions.items():
            self.offer(bus, key, action)
        for key in keys.SAMPLES:
            bus.serve(key, self._sample, fallback=self._refuse, wildcards=True)
        bus.serve(keys.BLACKBOX_SAVE, self._save, fallback=self._refuse)

    def hear_estop(self, bus: Bus, at: str) -> None:
        bus.alarm(
            at,
            self._estop_samples,
            self._release_samples,
            harmless=is_release_attempt,
            idle=self.operator.count_not_pressed,
            asks_nothing=is_not_pressed,
        )

    def offer(
        self, bus: Bus, key: str, action: Action, answer: Answer | None = None, *, at: str = ""
    ) -> None:
        """Serve one action.

        Args:
            answer: Encodes the reply; unless given, in the encoding of the request.
            at: The key on which it is offered, if that is another one.
        """
        encode = answer or self._answer
        estop = key == keys.ESTOP

        async def acknowledged(request: BusQuery, reply: ServiceReply) -> Response:
            reply = await self.operator.acknowledged(reply.message)
            words = f"{reply.message} {_seen(reply.data)}".rstrip()
            return encode(request, msgspec.structs.replace(reply, message=words))

        def respond(request: BusQuery) -> Response | Awaitable[Response]:
            reply = action(request)
            # The acknowledgement follows when the stop was sent and the latch is on file.
            return (acknowledged if estop and reply.success else encode)(request, reply)

        bus.serve(
            at or key,
            respond,
            fallback=lambda reason, request: encode(
                request, ServiceReply(success=False, message=_refusal(reason, request))
            ),
            wildcards=key in keys.READ_ONLY,
            # A Trigger has no data, so it asks for no release.
            harmless=partial(is_release_attempt, query="Trigger_" not in at) if estop else None,
            # A client that names no target reaches one service that is complete, or all that are
            # not: two daemons on one key must both stop. rmw_zenoh asks only complete ones.
            complete=not estop or "::dds_::" in at,
        )

    def _sample(self, request: BusQuery) -> Response:
        """The newest sample of the key, as it was published or would have been."""
        sample = self._newest(request.key)
        if sample is None:
            return self._refuse(f"There was no sample on {request.key} yet.", request)
        return Response(
            payload=encode_sample(sample, self._encoding),
            encoding=encoding_name(type(sample), self._encoding),
        )

    async def _save(self, request: BusQuery) -> Response:
        return self._answer(request, await self._save_box())

    def _refuse(self, reason: str, request: BusQuery) -> Response:
        return self._answer(request, ServiceReply(success=False, message=reason))

    def _estop_samples(self, count: int, unread: int) -> None:
        by = f"a sample on yahboomd/estop{senders(self._neighbours())}"
        self.operator.engage_estop(by, times=count, unread=unread)

    def _release_samples(self, count: int) -> None:
        self.operator.refuse_release("a sample on yahboomd/estop", times=count)

    def _estop_query(self, request: BusQuery) -> ServiceReply:
        if request.harmless:
            words = self.operator.refuse_release("a query on yahboomd/estop")
            return ServiceReply(success=False, message=words)
        unread = request.oversize or len(request.payload) > READ_BYTES
        name = "" if unread else estop_by(request.payload)
        by = name or f"a query on yahboomd/estop{senders(self._neighbours())}"
        words = self.operator.engage_estop(by, unread=int(unread))
        return ServiceReply(success=True, message=words)

    def _estop_reset(self, _request: BusQuery) -> ServiceReply:
        released, words = self.operator.release_estop()
        return ServiceReply(success=released, message=words)

    def _odometry_reset(self, _request: BusQuery) -> ServiceReply:
        return ServiceReply(success=True, message=self.operator.set_pose(Pose2d(), None))

    def _set_pose(self, request: BusQuery) -> ServiceReply:
        wanted = decode_set_pose(request.payload)
        if isinstance(wanted, Refusal):
            problem = f"{wanted.reason}: {wanted.detail}" if request.payload else "no pose was sent"
            words = f"The pose stays as it is: {problem}. {SET_POSE_TAKES}"
            return ServiceReply(success=False, message=words)
        pose = Pose2d(x=wanted.x, y=wanted.y, theta=wanted.theta)
        return ServiceReply(success=True, message=self.operator.set_pose(pose, wanted.covariance))

    def _answer_config(self, _request: BusQuery) -> ServiceReply:
        data = {"version": __version__, **self._config()}
        return ServiceReply(success=True, message="The configuration in effect.", data=data)

    def _answer_board(self, _request: BusQuery) -> ServiceReply:
        data = self._board()
        known = bool(data.get("dialect"))
        words = "The board's answers at connecting." if known else "No board is connected."
        return ServiceReply(success=known, message=words, data=data)

    def _answer(self, request: BusQuery, reply: ServiceReply) -> Response:
        encoding: Encoding = self._encoding
        if asked := request.payload or request.head:
            encoding = encoding_of(asked) or self._encoding
        return Response(
            payload=encode_reply(reply, encoding), encoding=encoding_name(ServiceReply, encoding)
        )


def _seen(data: Mapping[str, Any]) -> str:
    """The sentence on the counts after an e-stop; they follow it later than the answer."""
    if not data["sent"]:
        return ""
    if data["stands"] is None:
        return "It was sent; no counts show whether the wheels stand."
    if data["stands"]:
        return "It was sent, and the wheels stand."
    return f"It was sent; at that moment the counts showed wheels at {data['fastest_m_s']:.2f} m/s."


def _refusal(reason: str, request: BusQuery) -> str:
    if reason == TOO_MANY and not request.harmless:
        return f"{reason} The emergency stop is engaged all the same: yahboomd/status shows it."
    return reason
