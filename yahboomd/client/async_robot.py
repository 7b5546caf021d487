"""The client for asyncio programs: drives a robot, reads its samples and calls its services."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import msgspec

from yahboomd.client.commanding import Commands, Counters, number
from yahboomd.client.connection import ENDPOINT, Connection, client_options
from yahboomd.client.endings import Endings
from yahboomd.client.robot_moves import MoveRun, RobotMoves
from yahboomd.client.services import own_source, person_in, silence_of
from yahboomd.client.streams import (
    MAX_BYTES,
    MOTION,
    Newest,
    NewestSamples,
    Samples,
    depth_of,
    key_of,
    read_sample,
)
from yahboomd.core.bus import keys
from yahboomd.core.bus.options import BusOptions
from yahboomd.core.bus.subscriptions import Arrival
from yahboomd.core.clock import Clock, SystemClock, seconds, timeout
from yahboomd.core.errors import BusError, NoDaemon
from yahboomd.core.messages.native import StatusSample, WheelsSample
from yahboomd.core.model import Twist2d
from yahboomd.core.names import name_problem
from yahboomd.core.standstill import Standstill

if TYPE_CHECKING:
    from typing_extensions import Self

log = logging.getLogger("yahboomd.client")

Message = TypeVar("Message", bound=msgspec.Struct)

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
            for stream in self._streams:
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
        standstill = Standstill()
        stream = self.samples(WheelsSample)
        try:
            async with timeout(within_s):
                async for sample in stream:
                    if standstill.measure(sample.stamp_ns, sample.speed_m_s):
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
        stream = Samples(
            self.bus, message, kept, lambda at_ns: self._judge_age(message, kept, at_ns)
        )
        self._streams = [*(each for each in self._streams if each.is_open), stream]
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


def connect(
    endpoint: str | Sequence[str] = ENDPOINT,
    *,
    namespace: str = "",
    source: str | None = None,
    label: str = "",
    deadman_s: float = DEADMAN_S,
    rate_hz: float = RATE_HZ,
    wait_s: float = WAIT_S,
    zenoh_file: str | Path | None = None,
) -> AsyncRobot:
    """Make a robot for asyncio, to be entered by ``async with``.

    Entering waits for the daemon; leaving stops the robot, also after an exception. In between a
    lost connection reconnects by itself.

    Args:
        endpoint: The address of the daemon or its router, or several of them.
        namespace: The robot's, as in the section ``[zenoh]`` of its configuration.
        source: The key to command on; the daemon's ``[command.sources]`` gives it its priority.
            Default: ``cmd_vel``; with a person's file of a fleet, ``cmd_vel/NAME``.
        label: Who commands, for people who read the daemon's status.
        deadman_s: How long a command without ``for_s`` lasts, in seconds.
        rate_hz: How often a command is repeated. The daemon stops the robot after 0.5 s of silence.
        wait_s: How long entering waits for the daemon, in seconds; 0: one try, ``math.inf``:
            without limit.
        zenoh_file: A JSON5 file of Zenoh's, for certificates and passwords.

    Raises:
        ValueError: An argument is out of range.
        NoDaemon: (On entering) no daemon answers there in time; the message includes a remedy.
        BusError: (On entering) the endpoint, the namespace or the file cannot be used.
    """
    return AsyncRobot(
        client_options(endpoint, namespace=namespace, zenoh_file=zenoh_file),
        source=source,
        label=label,
        deadman_s=deadman_s,
        rate_hz=rate_hz,
        wait_s=wait_s,
    )
