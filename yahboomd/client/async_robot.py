"""The client for asyncio programs: drives a robot, reads its samples and calls its services."""

from __future__ import annotations

import asyncio
import logging
import math
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any, TypeVar

import msgspec

from yahboomd.client.commanding import Commands, Counters, number
from yahboomd.client.connection import MAX_BYTES, Connection
from yahboomd.client.endings import Endings
from yahboomd.client.move_messages import Move
from yahboomd.client.move_run import MoveRun
from yahboomd.client.person import own_source, person_in
from yahboomd.client.questions import (
    Answer,
    ask,
    ask_urgently,
    read_answers,
    silence_of,
    which_count,
)
from yahboomd.client.robot_moves import RobotMoves
from yahboomd.client.streams import (
    MOTION,
    Newest,
    NewestSamples,
    Samples,
    depth_of,
    key_of,
    read_sample,
)
from yahboomd.core.bus import keys
from yahboomd.core.bus.alarms import READ_BYTES
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.options import BusOptions
from yahboomd.core.bus.subscriptions import Arrival
from yahboomd.core.clock import Clock, SystemClock, seconds, timeout
from yahboomd.core.errors import BusError, NoDaemon, Refused
from yahboomd.core.messages.codecs import encode
from yahboomd.core.messages.native import EstopRequest, SetPoseRequest, StatusSample, WheelsSample
from yahboomd.core.model import STANDING_M_S, STANDING_READINGS, Twist2d
from yahboomd.core.names import name_problem

if TYPE_CHECKING:
    from typing_extensions import Self

log = logging.getLogger("yahboomd.client")

Message = TypeVar("Message", bound=msgspec.Struct)

ENDPOINT = "tcp/127.0.0.1:7448"
"""A daemon's default endpoint, for this machine only."""

DEADMAN_S = 1.0
RATE_HZ = 20.0
WAIT_S = 5.0

LISTEN_S = 1.0
"""The least time that an open session listens before it reports that no daemon is there."""

CONFIG_TRIES = 3

OLD_S = 0.3
"""A pose that arrived longer ago is too old to drive by."""


class AsyncRobot(NewestSamples, RobotMoves):
    """One robot, through its daemon. Made by :func:`connect`, which explains the arguments.

    An asynchronous context manager: entering waits for the daemon, leaving stops the robot, also
    after an exception, a cancellation, Ctrl-C, SIGTERM and SIGHUP. All methods belong to the event
    loop in which it was entered.
    """

    def __init__(
        self,
        options: BusOptions,
        *,
        source: str | None = None,
        label: str = "",
        deadman_s: float = DEADMAN_S,
        rate_hz: float = RATE_HZ,
        wait_s: float = WAIT_S,
        clock: Clock | None = None,
    ) -> None:
        self._person = person_in(options.config_file)
        if source is None:
            source = own_source(self._person) if self._person else keys.CMD_VEL
        if problem := name_problem(source):
            raise ValueError(f"The source {source!r} cannot be used: {problem}.")
        if not (deadman_s > 0.0 and 5.0 <= rate_hz <= 1000.0 and wait_s >= 0.0):
            raise ValueError("deadman_s > 0, 5 <= rate_hz <= 1000 and wait_s >= 0 must hold.")
        self._clock = clock or SystemClock()
        self._connection = Connection(options, self._clock, self._presence_changed)
        self._commands = Commands(
            self._connection,
            self._clock,
            source=source,
            label=label,
            deadman_s=deadman_s,
            rate_hz=rate_hz,
        )
        self._source = source
        self._label = label
        self._wait_s = wait_s
        self._streams: list[Samples[Any]] = []
        self._runs: list[MoveRun] = []
        self._newest: dict[type[msgspec.Struct], Newest] = {}
        self._read: dict[type[msgspec.Struct], msgspec.Struct] = {}
        self._warned_of_age = False
        self._endings = Endings()
        self._joined = False
        self._closing: asyncio.Task[None] | None = None
        self._learning: asyncio.Task[None] | None = None

    # Entering and leaving.

    async def __aenter__(self) -> Self:
        try:
            begun_ns = self._clock.now_ns()
            await self.join(self._wait_s)
            left_s = self._wait_s - seconds(self._clock.now_ns() - begun_ns)
            await self._connection.wait_alive(max(left_s, LISTEN_S))
            # If an access control refuses this, the next status comes within half a second.
            with suppress(NoDaemon):
                if (status := await self.get(StatusSample)) is not None:
                    self._connection.learn_status(status)
            if self._learning is not None:
                await asyncio.wait([self._learning], timeout=LISTEN_S)
        except BaseException:
            await self.close()
            raise
        self._endings.begin_async()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def join(self, wait_s: float) -> None:
        """Open the session without waiting for a daemon behind it; ``async with`` does both.

        Args:
            wait_s: How long to wait for a router, in seconds; 0: one try, ``math.inf``: without
                limit.

        Raises:
            NoDaemon: Nothing answers there in time.
            BusError: The endpoint, the namespace or the file cannot be used.
        """
        if self._joined:
            raise BusError("A robot is entered once.", remedy="Make another one with connect().")
        self._joined = True
        await self._connection.open(wait_s)
        self._commands.open()

    async def close(self) -> None:
        """Stop the robot and end the session, as ``async with`` does at its end.

        This takes some 0.3 s; a cancellation takes effect afterwards.
        """
        if self._closing is None:
            self._closing = asyncio.create_task(self._leave(), name="client-leave")
        cancelled = False
        while not self._closing.done():
            try:
                await asyncio.shield(self._closing)
            except asyncio.CancelledError:
                cancelled = True
        self._endings.end()
        if cancelled:
            raise asyncio.CancelledError

    async def _leave(self) -> None:
        try:
            for run in self._runs:
                await run.end()
            await self._commands.close()
        finally:
            for stream in list(self._streams):
                stream.close()
            if self._learning is not None:
                self._learning.cancel()
            await self._connection.close()

    # Presence.

    @property
    def alive(self) -> bool:
        """Whether the daemon is there now."""
        return self._connection.alive

    @property
    def problem(self) -> str:
        """The reason why no daemon is there, in a sentence; empty while one is."""
        return self._connection.problem

    @property
    def is_open(self) -> bool:
        """Whether a router answered; from then on the session reconnects by itself."""
        return self._connection.is_open

    @property
    def bus(self) -> Bus:
        """The session itself, for keys that have no method here.

        Raises:
            NoDaemon: It is not open.
        """
        return self._connection.bus

    async def wait_alive(self, wait_s: float = math.inf) -> None:
        """Wait until the daemon is there (again).

        Raises:
            NoDaemon: It is not there within ``wait_s`` seconds.
        """
        await self._connection.wait_alive(wait_s)

    def _presence_changed(self, alive: bool) -> None:
        self._commands.presence_changed(alive)
        if self._learning is not None:
            self._learning.cancel()
            self._learning = None
        if alive:
            self._learning = asyncio.create_task(self._learn_silence(), name="client-learn")
        else:
            for newest in self._newest.values():
                newest.take()
            self._read.clear()

    async def _learn_silence(self) -> None:
        self._commands.learn_silence(None)
        for _ in range(CONFIG_TRIES):
            # A busy daemon may answer too late, and an access control may hide the answer.
            if payloads := await self.ask(keys.CONFIG):
                self._commands.learn_silence(silence_of(payloads, self._source))
                return

    # Driving.

    def drive(
        self, vx: float = 0.0, wz: float = 0.0, *, vy: float = 0.0, for_s: float | None = None
    ) -> bool:
        """Command a velocity, repeated until the next command, a stop, or the end of its time.

        Without ``for_s`` call it again within the deadman's time (1 s): so a program that hangs
        does not keep driving. A command ends when the daemon is lost; it is never sent later. It
        also ends if this program does not run for as long as the daemon waits for its source (the
        source's ``timeout_s``; 0.5 s unless configured): the robot has stopped by then.

        Args:
            vx: Forward, m/s.
            wz: Counter-clockwise, rad/s.
            vy: To the left, m/s; for mecanum wheels.
            for_s: How long to repeat it, in seconds; ``math.inf``: until the next command.

        Returns:
            Whether it is sent; without a daemon it is dropped and counted.

        Raises:
            ValueError: A velocity is not finite, or ``for_s`` is not positive.
            TypeError: One of them is not a number: a text, for example, or a bool.
        """
        twist = Twist2d(vx=number("vx", vx), vy=number("vy", vy), wz=number("wz", wz))
        return self._commands.drive(twist, None if for_s is None else number("for_s", for_s))

    def stop(self, label: str | None = None) -> None:
        """Command zero at once, for 0.3 s; then nothing, so that other sources may drive.

        Args:
            label: Who or what commands this stop, for people; the client's own unless given.
        """
        self._commands.stop(label)

    @property
    def commanded(self) -> Twist2d | None:
        """The velocity that is published now, zeros included; None while nothing is."""
        return self._commands.commanded

    @property
    def heard(self) -> bool:
        """Whether the daemon subscribes to this client's source."""
        return self._commands.heard

    @property
    def counters(self) -> Counters:
        """The fate of this client's commands, counted."""
        return self._commands.counters

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

    async def finished(self) -> bool:
        """Wait until the latest command has ended, its zeros included.

        Returns:
            Whether it ended by its time or a stop; False if the daemon was lost.

        Raises:
            CommandEnded: This program did not run for as long as the daemon waits for commands, so
                the robot stopped; call :meth:`drive` again to continue.
        """
        return await self._commands.finished()

    async def standing(self, within_s: float = 2.0) -> bool:
        """Wait until the wheels are measured to stand.

        Returns:
            Whether they do; False if they still turn after ``within_s`` seconds, or no samples of
            them come.
        """
        slow = 0
        stream = self.samples(WheelsSample)
        try:
            async with timeout(within_s):
                async for sample in stream:
                    speeds = [abs(speed) for speed in sample.speed_m_s]
                    stands = bool(speeds) and max(speeds) < STANDING_M_S
                    slow = slow + 1 if stands else 0
                    if slow >= STANDING_READINGS:
                        return True
        except TimeoutError:
            pass
        finally:
            stream.close()
        return False

    # Samples.

    def newest(self, message: type[Message]) -> Message | None:
        """The newest sample, such as ``robot.newest(PoseSample)``.

        The first call subscribes. No Python code runs when a sample comes, only when it is read.

        Returns:
            None if none came since the daemon was found.
        """
        if message is StatusSample:
            return self._connection.status  # type: ignore[return-value]
        newest = self._newest.get(message)
        if newest is None:
            newest = self._newest[message] = Newest(self.bus, key_of(message))
        payload = newest.take()
        if payload is not None and (sample := read_sample(payload, message)) is not None:
            self._read[message] = sample
        return self._read.get(message)  # type: ignore[return-value]

    def samples(self, message: type[Message], *, depth: int | None = None) -> Samples[Message]:
        """Samples as they come: ``async for pose in robot.samples(PoseSample)``.

        A slower reader gets the newest one, or the newest 64 events. The iterator survives restarts
        of the daemon, and ends when the robot is left. When a loop takes a pose, twist, wheels or
        IMU sample that arrived more than 0.3 s ago, a warning is logged, once for each robot.

        Args:
            message: The kind, such as ``EventSample``.
            depth: The length of the queue, for a reader that needs every sample; the oldest samples
                are dropped and counted. A reader of a full queue gets samples this many behind.

        Raises:
            ValueError: ``depth`` is below 1, or a daemon publishes no such message.
        """
        kept = depth_of(message, depth)
        stream = Samples(message, kept, lambda at_ns: self._judge_age(message, kept, at_ns))
        subscription = self.bus.subscribe(
            key_of(message), stream.receive, depth=kept, max_bytes=MAX_BYTES
        )

        def end() -> None:
            subscription.close()
            self._streams.remove(stream)

        stream.attach(end)
        self._streams.append(stream)
        return stream

    def _judge_age(self, message: type[msgspec.Struct], depth: int, arrived_ns: int) -> None:
        age_s = seconds(self._clock.now_ns() - arrived_ns)
        if age_s <= OLD_S or message not in MOTION or self._warned_of_age:
            return
        # A queue was asked for, so old samples are expected unless this program drives.
        if depth > 1 and not self._commands.moves:
            return
        self._warned_of_age = True
        why = (
            f"samples() has a queue (depth={depth}) and this program is slower than they come. "
            "Without depth it gets the newest."
            if depth > 1
            else "None came since, or this program did not let its event loop run. "
            "Stop the robot when that happens."
        )
        log.warning("The %s taken arrived %.1f s ago. %s", message.__name__, age_s, why)

    def on(
        self,
        message: type[Message],
        callback: Callable[[Message], object],
        *,
        depth: int | None = None,
    ) -> Callable[[], None]:
        """Call back when samples come, on the event loop.

        Args:
            message: The kind, such as ``EventSample``.
            callback: Has to return soon: the same loop repeats commands. A slower one gets the
                newest sample, or the newest 64 events.
            depth: Samples queued for a slow callback.

        Returns:
            A function that ends it.
        """

        def receive(arrivals: list[Arrival]) -> None:
            for arrival in arrivals:
                if (sample := read_sample(arrival.payload, message)) is not None:
                    callback(sample)

        kept = depth_of(message, depth)
        return self.bus.subscribe(key_of(message), receive, depth=kept, max_bytes=MAX_BYTES).close

    async def get(self, message: type[Message], *, timeout_s: float = 1.5) -> Message | None:
        """Ask the daemon for its newest sample, whenever it was published.

        Returns:
            None if there is none yet.

        Raises:
            NoDaemon: No daemon answers within ``timeout_s`` seconds.
        """
        payloads = await self.ask(key_of(message), timeout_s=timeout_s)
        if not payloads:
            raise self._connection.no_daemon()
        samples = (read_sample(payload, message) for payload in payloads)
        return next((sample for sample in samples if sample is not None), None)

    # Services.

    async def ask(
        self, key: str, payload: bytes = b"{}", *, timeout_s: float = 1.5, urgent: bool = False
    ) -> list[bytes]:
        """Query any key below the namespace; the payload of each answer."""
        bus = self.bus
        return await ask(bus.session, bus.key(key), payload, timeout_s=timeout_s, urgent=urgent)

    async def request(
        self, key: str, payload: bytes = b"{}", *, timeout_s: float = 1.5, urgent: bool = False
    ) -> Answer:
        """Ask a service; return the outcome, also if it refuses."""
        return read_answers(await self.ask(key, payload, timeout_s=timeout_s, urgent=urgent))

    async def call(
        self, key: str, payload: bytes = b"{}", *, timeout_s: float = 1.5, urgent: bool = False
    ) -> Answer:
        """Ask a service; return the outcome, or raise if it is not done.

        Raises:
            NoDaemon: No daemon answers within ``timeout_s`` seconds.
            Refused: A daemon refused; the message has the reason.
        """
        return self._done(await self.request(key, payload, timeout_s=timeout_s, urgent=urgent))

    async def ask_by_name(self, key: str, payload: bytes = b"{}") -> tuple[list[bytes], str]:
        """Query a service that changes something; in a fleet by the key that proves who asks.

        The name is that of the person's file (``zenoh_file``). If no daemon answers on this key,
        the common one is asked. The emergency stop waits for no answer: it is asked for on both
        keys at once.

        Returns:
            The payload of each answer, and a sentence if they prove no name although there is one.
        """
        stops = key == keys.ESTOP
        if not self._person:
            return await self.ask(key, payload, urgent=stops), ""
        own = keys.own_key(key, self._person)
        if stops:
            bus = self.bus
            in_full = (bus.key(own), bus.key(key))
            named, common = await ask_urgently(bus.session, in_full, payload)
        else:
            named = await self.ask(own, payload)
            common = [] if named else await self.ask(key, payload)
        unproven = ""
        if len(named) < len(common):
            which = "not every daemon" if named else "nothing"
            unproven = f"Asked without a proven name: {which} answers on {own}."
        return which_count(named, common), unproven

    async def request_by_name(self, key: str, payload: bytes = b"{}") -> Answer:
        """Ask as :meth:`ask_by_name` does; the message tells if no name is proven."""
        payloads, unproven = await self.ask_by_name(key, payload)
        answer = read_answers(payloads)
        words = f"{answer.message} {unproven}".rstrip()
        return msgspec.structs.replace(answer, message=words)

    def _done(self, answer: Answer) -> Answer:
        if not answer.answered:
            raise self._connection.no_daemon()
        if not answer.success:
            raise Refused(answer.message)
        return answer

    async def estop(self, by: str = "") -> str:
        """Engage the emergency stop of every daemon there; it stays until :meth:`release`.

        Args:
            by: Who or what asks, for people. Default: the client's label, else the name and the
                number of this process.

        Returns:
            The daemon's acknowledgement.

        Raises:
            NoDaemon: No daemon acknowledged it. Switch the motors' supply off.
            Refused: A daemon answered that it did not engage, or could not send it to the board.
        """
        if self.commanded is not None:
            self.stop()
        payload = estop_payload(by or self._label)
        return self._done(await self.request_by_name(keys.ESTOP, payload)).message

    async def release(self) -> str:
        """Release the emergency stop, and clear a fault; returns the daemon's words.

        Raises:
            NoDaemon: No daemon answers.
            Refused: A source commanded motion within the last second.
        """
        return self._done(await self.request_by_name(keys.ESTOP_RESET)).message

    async def reset_odometry(self) -> str:
        """Make the pose zero; returns the daemon's words."""
        return self._done(await self.request_by_name(keys.ODOMETRY_RESET)).message

    async def set_pose(
        self, x: float, y: float, theta: float, *, covariance: Sequence[float] | None = None
    ) -> str:
        """Make odometry continue from this pose; returns the daemon's words.

        Args:
            x: Metres.
            y: Metres.
            theta: Radians, counter-clockwise.
            covariance: Nine numbers over (x, y, theta), row by row; None: known exactly.

        Raises:
            Refused: A number is out of range, or the covariance is not a valid one.
        """
        given = None if covariance is None else tuple(float(each) for each in covariance)
        wanted = SetPoseRequest(x=x, y=y, theta=theta, covariance=given)  # type: ignore[arg-type]
        payload = encode(wanted, "json")
        return self._done(await self.request_by_name(keys.ODOMETRY_SET_POSE, payload)).message

    async def config(self) -> dict[str, Any]:
        """The daemon's configuration in effect, by section and key."""
        return (await self.call(keys.CONFIG)).data

    async def board(self) -> dict[str, Any]:
        """What the daemon knows of the board: firmware, settings, problems.

        Raises:
            Refused: No board is connected.
        """
        return (await self.call(keys.BOARD)).data


def estop_payload(by: str = "") -> bytes:
    """The payload that engages the e-stop, with the name of who asks; default: this process.

    A name that is too long for the daemon is cut.
    """
    program = os.path.basename(sys.argv[0]) if sys.argv else ""
    named = program not in {"", "-c"}
    by = by or f"{program if named else 'python'} (pid {os.getpid()})"
    while len(payload := encode(EstopRequest(by=by), "json")) > READ_BYTES:
        by = by[:-1]
    return payload
