"""Moves of a robot to a goal: asked for, kept alive, followed to their end."""

from __future__ import annotations

import asyncio
import math
import secrets
from collections import deque
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Protocol

import msgspec
import zenoh

from yahboomd.client.commanding import number
from yahboomd.client.move_messages import (
    BEAT,
    BEAT_S,
    CANCEL,
    HOLDER,
    MOST_MOVES,
    MOVES,
    PAUSE,
    RESUME,
    START,
    Move,
    MoveBeat,
    MoveChoice,
    MoveRequest,
    MoveSample,
    Reason,
)
from yahboomd.client.services import Answer, RobotServices
from yahboomd.client.streams import MAX_BYTES, read_sample
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.subscriptions import Arrival, Subscription
from yahboomd.core.errors import NoDaemon, Refused, YahboomdError
from yahboomd.core.messages.codecs import encode, encoding_name

if TYPE_CHECKING:
    from typing_extensions import Self

ASK_S = 3.0
"""The longest wait for the answer to a start: the service may have to ask the daemon first."""

KNOWN_S, AGAIN_S = 1.0, 0.05
"""A session that has just begun may know a service a moment later: it is asked for this time."""

SERVICE_S = 2.0
"""Progress comes ten times a second; without any for this time, the service is gone."""

KEPT = 64

REMEDY = "Start it: `yahboomd moves`, or sudo systemctl enable --now yahboomd-moves."


class MoveEnded(YahboomdError):
    """The moves ended before their goal.

    Attributes:
        reason: A word such as ``taken_over`` or ``blocked``; docs/moves.md lists them all.
    """

    exit_code = 1

    def __init__(self, reason: Reason | str, message: str) -> None:
        super().__init__(message or f"The moves ended: {reason}.")
        self.reason = reason


class Asking(Protocol):
    """The methods of a robot that moves need."""

    @property
    def bus(self) -> Bus: ...

    async def request(
        self, key: str, payload: bytes = b"{}", *, timeout_s: float = 1.5
    ) -> Answer: ...


class MoveRun:
    """Moves in a row: ``async with robot.moves(...) as run:``, made by ``AsyncRobot.moves``.

    Entering asks for them; leaving ends them, if they are not over. An asynchronous iterator over
    their progress, which ends with them. ``await run.finished()`` waits for the goal.

    Args:
        beats: Whether it keeps the moves alive by itself; if not, each :meth:`beat` does.
    """

    def __init__(
        self,
        robot: Asking,
        moves: Sequence[Move],
        *,
        by: str = "",
        uncertain_m: float | None = None,
        beats: bool = True,
    ) -> None:
        if not 1 <= len(moves) <= MOST_MOVES:
            raise ValueError(f"1 to {MOST_MOVES} moves can be asked for at once, not {len(moves)}.")
        self.id = ""
        self.newest: MoveSample | None = None
        self._robot = robot
        self._beats = beats
        self._holder = secrets.token_hex(8)
        self._request = MoveRequest(
            moves=tuple(moves), by=by or None, holder=self._holder, uncertain_m=uncertain_m
        )
        self._samples: deque[MoveSample] = deque(maxlen=KEPT)
        self._came = asyncio.Event()
        self._over = asyncio.Event()
        self._beating: asyncio.Task[None] | None = None
        self._token: zenoh.LivelinessToken | None = None
        self._subscription: Subscription | None = None

    # Begin and end.

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.end()

    async def start(self) -> None:
        """Ask for the moves, as ``async with`` does.

        Raises:
            NoDaemon: No `yahboomd moves` answers.
            Refused: It does not drive them; the message has the reason.
        """
        bus = self._robot.bus
        self._token = bus.session.liveliness().declare_token(bus.key(f"{HOLDER}/{self._holder}"))
        self._subscription = bus.subscribe(MOVES, self._receive, depth=KEPT, max_bytes=MAX_BYTES)
        try:
            self.id = await self._ask()
        except BaseException:
            self._release()
            raise
        for sample in [each for each in self._samples if each.id != self.id]:
            self._samples.remove(sample)
        self._beating = asyncio.create_task(self._keep(), name="client-moves")
        self._look()

    async def _ask(self) -> str:
        now_s = asyncio.get_running_loop().time
        until_s = now_s() + KNOWN_S
        while True:
            payload = encode(self._request, "json")
            answer = await self._robot.request(START, payload, timeout_s=ASK_S)
            # A query that no service takes ends at once, so it can be asked again.
            if answer.answered or now_s() > until_s:
                break
            await asyncio.sleep(AGAIN_S)
        if not answer.answered:
            raise NoDaemon("No `yahboomd moves` answers: nothing was driven.", remedy=REMEDY)
        if not answer.success:
            raise Refused(answer.message)
        return str(answer.data.get("id", ""))

    @property
    def is_over(self) -> bool:
        """Whether they have ended, or their service is gone."""
        return self._over.is_set()

    async def end(self) -> None:
        """End the moves, if they are not over: the robot stops. Safe to call twice."""
        if self._beating is None:
            return
        beating, self._beating = self._beating, None
        beating.cancel()
        # Even if the request fails, moves without beats and token end by themselves.
        self._release_token()
        try:
            if not self._over.is_set():
                await asyncio.shield(self._choose(CANCEL))
        finally:
            self._release()

    def _release_token(self) -> None:
        if self._token is not None:
            self._token.undeclare()
            self._token = None

    def _release(self) -> None:
        self._release_token()
        if self._subscription is not None:
            self._subscription.close()
            self._subscription = None
        self._over.set()
        self._came.set()

    def beat(self) -> None:
        """Keep the moves alive for half a second more."""
        bus = self._robot.bus
        bus.session.put(
            bus.key(BEAT),
            encode(MoveBeat(id=self.id), "json"),
            encoding=encoding_name(MoveBeat, "json"),
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
        )

    async def _keep(self) -> None:
        heard = asyncio.get_running_loop().time()
        newest = self.newest
        while not self._over.is_set():
            if self._beats:
                self.beat()
            await asyncio.sleep(BEAT_S)
            now = asyncio.get_running_loop().time()
            if self.newest is not newest:
                newest, heard = self.newest, now
            elif now - heard > SERVICE_S:
                self._over.set()
                self._came.set()

    # While they are driven.

    async def pause(self) -> None:
        """Make the robot stop on its way; :meth:`resume` continues the moves."""
        await self._chosen(PAUSE)

    async def resume(self) -> None:
        """Continue paused moves."""
        await self._chosen(RESUME)

    async def _chosen(self, key: str) -> None:
        answer = await self._choose(key)
        if not answer.success:
            raise Refused(answer.message)

    async def _choose(self, key: str) -> Answer:
        return await self._robot.request(key, encode(MoveChoice(id=self.id), "json"))

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> MoveSample:
        """The next progress; the last one has the reason of the end."""
        while not self._samples:
            if self._over.is_set():
                raise StopAsyncIteration
            self._came.clear()
            await self._came.wait()
        return self._samples.popleft()

    async def finished(self) -> MoveSample:
        """Wait for the end.

        Returns:
            The last progress, with the reason ``reached``.

        Raises:
            MoveEnded: They ended before the goal.
            NoDaemon: `yahboomd moves` is gone.
        """
        await self._over.wait()
        newest = self.newest
        if newest is None or newest.state != "ended":
            if self._beating is None:
                raise MoveEnded("cancelled", "This program ended the moves.")
            raise NoDaemon(
                "`yahboomd moves` is gone: the robot stops by itself.",
                remedy=REMEDY,
            )
        if newest.reason != "reached":
            raise MoveEnded(newest.reason, newest.message)
        return newest

    def _receive(self, arrivals: list[Arrival]) -> None:
        for arrival in arrivals:
            sample = read_sample(arrival.payload, MoveSample)
            if sample is not None and self.id in {"", sample.id}:
                self._samples.append(sample)
        if self.id:
            self._look()

    def _look(self) -> None:
        if not self._samples:
            return
        self.newest = self._samples[-1]
        if self.newest.state == "ended":
            self._over.set()
        self._came.set()


LIMITS = (
    *("speed_m_s", "turn_rad_s", "acceleration_m_s2", "acceleration_rad_s2"),
    *("jerk_m_s3", "jerk_rad_s3", "look_ahead_m", "corner_m"),
)


class RobotMoves(RobotServices):
    """Moves to a goal. Each waits until it is reached, and raises ``MoveEnded`` if it is not.

    Every move takes limits of its own: ``speed_m_s``, ``turn_rad_s``, ``acceleration_m_s2``,
    ``acceleration_rad_s2``, ``jerk_m_s3`` and ``jerk_rad_s3``; ``follow`` and ``go_to`` also
    ``look_ahead_m`` and ``corner_m``. None of them exceeds the robot's configured limits.
    `yahboomd moves` has to run.
    """

    _runs: list[MoveRun]

    def moves(self, *moves: Move, uncertain_m: float | None = None) -> MoveRun:
        """Moves in a row: ``async with robot.moves(Move(kind="turn", angle_rad=1.57)) as run:``.

        In the block, ``async for progress in run:`` follows them to their end, and
        ``await run.finished()`` waits for the goal. Leaving the block ends them.

        Args:
            moves: 1 to 100 of them.
            uncertain_m: They end once the place is this uncertain (m, since their begin).
        """
        run = MoveRun(self, moves, by=self._label, uncertain_m=uncertain_m)
        self._runs = [each for each in self._runs if not each.is_over]
        self._runs.append(run)
        return run

    async def straight(
        self, /, distance_m: float, *, left_m: float = 0.0, **limits: float
    ) -> MoveSample:
        """Drive straight by metres; negative: backward.

        Args:
            distance_m: Ahead.
            left_m: To the left, on mecanum wheels.

        Raises:
            MoveEnded: It ended before its goal.
            Refused: It is not driven; the message has the reason.
            NoDaemon: No `yahboomd moves` answers.
        """
        move = Move(
            kind="straight",
            distance_m=number("distance_m", distance_m),
            left_m=number("left_m", left_m),
        )
        return await self._driven(move, limits)

    async def turn(
        self, /, radians: float | None = None, *, degrees: float | None = None, **limits: float
    ) -> MoveSample:
        """Turn in place, positive to the left; raises as :meth:`straight` does.

        Args:
            radians: By how much; or ``degrees``.
        """
        return await self._driven(Move(kind="turn", angle_rad=_angle(radians, degrees)), limits)

    async def arc(
        self,
        /,
        radius_m: float,
        radians: float | None = None,
        *,
        degrees: float | None = None,
        backward: bool = False,
        **limits: float,
    ) -> MoveSample:
        """Drive along an arc; raises as :meth:`straight` does.

        Args:
            radius_m: Of the way of the base's middle.
            radians: By how much the base turns, positive to the left; or ``degrees``.
            backward: Drive it backward.
        """
        move = Move(
            kind="arc",
            radius_m=number("radius_m", radius_m),
            angle_rad=_angle(radians, degrees),
            backward=backward,
        )
        return await self._driven(move, limits)

    async def go_to(
        self,
        /,
        x: float,
        y: float,
        theta: float | None = None,
        *,
        backward: bool = False,
        **limits: float,
    ) -> MoveSample:
        """Go to a place of the odometry frame; raises as :meth:`straight` does.

        Args:
            x: Metres.
            y: Metres.
            theta: The heading there, in radians; None: any.
            backward: Drive backward if that needs less turning.
        """
        move = Move(
            kind="go_to",
            x=number("x", x),
            y=number("y", y),
            theta=None if theta is None else number("theta", theta),
            backward=backward,
        )
        return await self._driven(move, limits)

    async def follow(
        self, /, points: Iterable[Sequence[float]], *, backward: bool = False, **limits: float
    ) -> MoveSample:
        """Follow a path; raises as :meth:`straight` does.

        Args:
            points: (x, y) or (x, y, theta) in metres and radians, in the odometry frame.
            backward: Drive backward if that needs less turning.
        """
        read = tuple(tuple(number("a point", each) for each in point) for point in points)
        if any(len(point) not in {2, 3} for point in read):
            raise ValueError("A point is (x, y) or (x, y, theta).")
        return await self._driven(Move(kind="follow", points=read, backward=backward), limits)

    async def _driven(self, move: Move, limits: dict[str, float]) -> MoveSample:
        for name in limits:
            if name not in LIMITS:
                raise TypeError(f"{name} is no limit of a move; these are: {', '.join(LIMITS)}.")
        async with self.moves(msgspec.structs.replace(move, **limits)) as run:
            return await run.finished()


def _angle(radians: float | None, degrees: float | None) -> float:
    if (radians is None) == (degrees is None):
        raise TypeError("Give the angle in radians, or as degrees=90.")
    if degrees is not None:
        return math.radians(number("degrees", degrees))
    return number("radians", radians)
