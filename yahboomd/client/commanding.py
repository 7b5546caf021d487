"""Publishes the velocities of one client: repeats and ends them, drops them without a daemon."""

from __future__ import annotations

import asyncio
import logging
from numbers import Real
from typing import Literal, TypeAlias

import msgspec
import zenoh

from yahboomd.client.connection import Connection
from yahboomd.client.streams import reason
from yahboomd.core.bus import keys
from yahboomd.core.bus.blocking import bounded
from yahboomd.core.bus.publishers import BusPublisher
from yahboomd.core.clock import Clock, Pause, PauseWatch, Schedule, nanoseconds
from yahboomd.core.errors import CommandEnded
from yahboomd.core.messages.codecs import encode
from yahboomd.core.messages.native import DRIVABLE, VelocityCommand
from yahboomd.core.model import STANDSTILL, Twist2d, velocity_problem

log = logging.getLogger("yahboomd.client")

SOON_NS = 5_000_000
"""New commands are published at once, but not more often than this."""

HEARD_NS = 1_000_000_000
"""Without a subscriber for this time, the daemon takes no commands on the key."""

SILENCE_S = {keys.CMD_VEL_TELEOP: 0.3, keys.CMD_VEL_WEB: 0.3, "cmd_vel/moves": 0.3}
"""The silence after which a daemon stops the robot, by source, as it is configured by default."""

OTHER_SILENCE_S = 0.5

LEAST_SILENCE_S = 0.03
"""A shorter one would end between two repetitions."""

REPEATS = 3
"""Repetitions within that silence, at least."""

LAST_PUT_S = 0.5
"""The longest wait for the last zero to be sent, if the connection is congested."""

ENCODING = "application/json;VelocityCommand"

LONGEST_S = 1e9
"""The stand-in for ``math.inf`` seconds; monotonic nanoseconds are integers."""


ZEROS_NS = 300_000_000
"""How long zeros are published after motion: seven at 20 Hz, of which one has to arrive."""

End: TypeAlias = Literal["", "time", "stop", "interrupted", "paused"]
"""The cause that ended the latest command: its time, a stop, a lost daemon, or a pause."""


def number(name: str, value: object) -> float:
    """A number that a program commands.

    Raises:
        TypeError: It is not a number; ``float()`` would accept True as 1 m/s, and texts.
    """
    if isinstance(value, bool) or not isinstance(value, Real):
        kind = type(value).__name__
        raise TypeError(f"{name} must be a number, not {value!r} ({kind}); see float().")
    return float(value)


class Counters(msgspec.Struct, kw_only=True):
    """Counters of the fate of one client's commands.

    Attributes:
        published: Commands given to Zenoh, repetitions and zeros included.
        dropped: Calls of ``drive`` while no daemon was there, and commands that Zenoh refused.
        interrupted: Commands that ended because the daemon was lost, or because this program did
            not run for as long as the daemon waits for its source (0.5 s): it was stopped or
            starved, or its machine was suspended.
        deadman: Commands for motion that ended because ``drive`` was not called again.
        losses: Times that the daemon was lost.
    """

    published: int = 0
    dropped: int = 0
    interrupted: int = 0
    deadman: int = 0
    losses: int = 0


class Commands:
    """The commands of one client on one key; ``AsyncRobot`` explains them.

    Args:
        label: Who commands, for people.
        deadman_s: How long a command without a time of its own lasts.
        rate_hz: How often it is repeated.
    """

    def __init__(
        self,
        connection: Connection,
        clock: Clock,
        *,
        source: str,
        label: str,
        deadman_s: float,
        rate_hz: float,
    ) -> None:
        self.counters = Counters()
        self._connection = connection
        self._clock = clock
        self._source = source
        self._label = label
        self._stops_as: str | None = None
        self._deadman_s = deadman_s
        self._rate_period_ns = nanoseconds(1.0 / rate_hz)
        self._repeater = Repeater()
        self._pauses = PauseWatch(clock)
        self._paused = ""
        self._by_deadman = False
        self._publisher: BusPublisher | None = None
        self._repeating: asyncio.Task[None] | None = None
        self._soon: asyncio.TimerHandle | None = None
        self._last: Twist2d | None = None
        self._last_ns = 0
        self._warned = ""
        self._closed = False
        self.learn_silence(None)

    def learn_silence(self, silence_s: float | None) -> None:
        """Set how long the daemon waits for this source; None if it is unknown."""
        if silence_s is None:
            silence_s = SILENCE_S.get(self._source, OTHER_SILENCE_S)
        # After this silence the robot has stopped by itself: the program has to command again.
        self._pauses.shortest_ns = nanoseconds(max(silence_s, LEAST_SILENCE_S))
        self._period_ns = min(self._rate_period_ns, self._pauses.shortest_ns // REPEATS)

    def open(self) -> None:
        """Declare the publisher, on an open connection."""
        self._publisher = self._connection.bus.publisher(
            self._source, encoding=ENCODING, priority="real_time", express=True
        )

    @property
    def heard(self) -> bool:
        """Whether something subscribes to the key."""
        return self._publisher is not None and self._publisher.has_subscribers

    @property
    def commanded(self) -> Twist2d | None:
        """The velocity that is published now, zeros included; None while nothing is."""
        return None if self._repeater.idle else self._repeater.twist or STANDSTILL

    @property
    def moves(self) -> bool:
        """Whether a velocity other than zero is being repeated."""
        return self._repeater.twist is not None and not self._repeater.twist.is_zero

    def drive(self, twist: Twist2d, for_s: float | None) -> bool:
        """Repeat a velocity; see ``AsyncRobot.drive``."""
        if (problem := velocity_problem(twist.vx, twist.vy, twist.wz)) is not None:
            raise ValueError(f"Not sent: {problem[1]}")
        if for_s is not None and not for_s > 0.0:
            raise ValueError(f"for_s must be positive, not {for_s}.")
        if self._closed or not self._connection.alive:
            self.counters.dropped += 1
            self._warn(f"A command is dropped. {self._connection.problem}".rstrip())
            return False
        # A pause before this command does not end it; one after it does, even before it is sent.
        self._pauses.detect()
        now_ns = self._clock.now_ns()
        self._by_deadman = for_s is None
        seconds = self._deadman_s if for_s is None else for_s
        self._repeater.drive(twist, now_ns + nanoseconds(min(seconds, LONGEST_S)))
        if self._soon is None and twist != self._last:
            wait_s = max(0, self._last_ns + SOON_NS - now_ns) / 1e9
            self._soon = asyncio.get_running_loop().call_later(wait_s, self._publish_soon)
        self._repeat()
        status = self._connection.status
        if status is not None and status.state not in DRIVABLE:
            self._warn(f"The robot cannot drive. {reason(status)}")
        return True

    def stop(self, label: str | None = None) -> None:
        """Publish a zero at once, and repeat it for a moment; under this label, if one is given."""
        self._stops_as = label
        if self._closed or not self._connection.alive:
            self._repeater.interrupt()
            return
        self._repeater.stop(self._clock.now_ns())
        self._publish()
        self._repeat()

    def presence_changed(self, alive: bool) -> None:
        """The daemon came or went: end the command if it is lost."""
        self._warned = ""
        if alive:
            return
        self.counters.losses += 1
        self.counters.interrupted += self._repeater.twist is not None
        self._repeater.interrupt()
        self._last = None

    async def finished(self) -> bool:
        """Wait for the end of the latest command; see ``AsyncRobot.finished``."""
        await self._idle()
        if self._repeater.ended == "paused":
            raise CommandEnded(self._paused, remedy="Call drive() again.")
        return self._repeater.ended != "interrupted"

    async def _idle(self) -> None:
        while self._repeating is not None and not self._repeating.done():
            await asyncio.wait([self._repeating])

    async def close(self) -> None:
        """Stop the robot if this client drives it, and publish nothing more."""
        # An idle client sends no zero: another source may drive by now.
        driving = not self._repeater.idle
        try:
            if self._repeater.twist is not None:
                self.stop()
            self._closed = True
            await self._idle()
        finally:
            self._closed = True
            for each in (self._soon, self._repeating):
                if each is not None:
                    each.cancel()
            if driving and self._connection.alive:
                await self._last_zero()

    async def _last_zero(self) -> None:
        # A congested connection may have dropped all zeros so far; this one waits for room.
        bus = self._connection.bus
        key, payload = bus.key(self._source), self._encoded(STANDSTILL)
        try:
            await bounded(
                lambda: bus.session.put(
                    key,
                    payload,
                    encoding=ENCODING,
                    congestion_control=zenoh.CongestionControl.BLOCK,
                    priority=zenoh.Priority.REAL_TIME,
                    express=True,
                ),
                timeout_s=LAST_PUT_S,
                name="client-last-zero",
            )
        except (TimeoutError, zenoh.ZError):
            log.warning("The last stop could not be sent; the daemon stops the robot by itself.")

    def _repeat(self) -> None:
        if self._repeating is None or self._repeating.done():
            self._repeating = asyncio.create_task(self._repeat_until_idle(), name="client-repeat")

    async def _repeat_until_idle(self) -> None:
        schedule = Schedule(self._clock, self._period_ns)
        heard_ns = self._clock.now_ns()
        try:
            while not self._repeater.idle:
                await schedule.beat()
                self._end_after(self._pauses.detect())
                self._publish()
                if self.heard:
                    heard_ns = self._clock.now_ns()
                # A lost daemon stops subscribing a moment before it is known to be gone.
                elif self._clock.now_ns() - heard_ns > HEARD_NS:
                    self._warn(
                        f"The daemon accepts no commands on {self._source}. Start it with "
                        f"--set 'command.sources.\"{self._source}\".priority=10'."
                    )
        finally:
            schedule.close()
            self._last = None

    def _end_after(self, pause: Pause | None) -> None:
        # The robot has stopped by itself meanwhile, and must not start again without a command.
        if pause is None or self._repeater.twist is None:
            return
        self.counters.interrupted += 1
        self._repeater.stop(self._clock.now_ns(), "paused")
        self._paused = (
            f"This program did not run for {pause.duration_s:.1f} s, so the robot stopped, and the "
            "command has ended."
        )
        self._warn(f"{self._paused} Call drive() again.")

    def _publish_soon(self) -> None:
        self._end_after(self._pauses.detect())
        self._publish()

    def _publish(self) -> None:
        if self._soon is not None:
            self._soon.cancel()
            self._soon = None
        before = self._repeater.twist
        twist = self._repeater.command(self._clock.now_ns())
        if self._by_deadman and before and not before.is_zero and not self._repeater.twist:
            self.counters.deadman += 1
            self._warn(
                f"The robot stops: drive() was not called again within {self._deadman_s:g} s. "
                "Call it more often, or give it a time: drive(..., for_s=3)."
            )
        if twist is None or self._publisher is None:
            return
        if self._publisher.put(self._encoded(twist)):
            self.counters.published += 1
            self._last, self._last_ns = twist, self._clock.now_ns()
        else:
            self.counters.dropped += 1

    def _encoded(self, twist: Twist2d) -> bytes:
        command = VelocityCommand(
            vx=twist.vx,
            vy=twist.vy,
            wz=twist.wz,
            # The daemon recognises a delayed command by its stamp, and refuses it.
            stamp_ns=self._clock.wall_ns(),
            source=(twist.is_zero and self._stops_as) or self._label or None,
        )
        return encode(command, "json")

    def _warn(self, words: str) -> None:
        if words != self._warned:
            self._warned = words
            log.warning("%s", words)


class Repeater:
    """The velocity to publish now: a command until its deadline, then zeros, then nothing.

    A zero command holds control of the robot as any other does, so the zeros end as well. Pure:
    callers pass monotonic nanoseconds.
    """

    def __init__(self) -> None:
        self._twist: Twist2d | None = None
        self._until_ns = 0
        self._zeros_until_ns: int | None = None
        self.ended: End = ""

    @property
    def twist(self) -> Twist2d | None:
        """The command that is being repeated; None while zeros or nothing is published."""
        return self._twist

    @property
    def idle(self) -> bool:
        """Whether nothing is published: no command, and its zeros are over."""
        return self._twist is None and self._zeros_until_ns is None

    def drive(self, twist: Twist2d, until_ns: int) -> None:
        """Repeat this command until a moment, or until the next one."""
        self._twist, self._until_ns = twist, until_ns
        self._zeros_until_ns = None
        self.ended = ""

    def stop(self, now_ns: int, why: End = "stop") -> None:
        """Publish zeros from now on, for :data:`ZEROS_NS`."""
        if self._twist is not None or why == "stop":
            self.ended = why
        self._twist = None
        self._zeros_until_ns = now_ns + ZEROS_NS

    def interrupt(self) -> None:
        """Publish nothing more: no daemon is there to receive it."""
        if self._twist is not None:
            self.ended = "interrupted"
        self._twist = self._zeros_until_ns = None

    def command(self, now_ns: int) -> Twist2d | None:
        """The velocity to publish at this moment; None for none."""
        if self._twist is not None and now_ns >= self._until_ns:
            self.stop(now_ns, "time")
        if self._twist is not None:
            return self._twist
        if self._zeros_until_ns is None or now_ns >= self._zeros_until_ns:
            self._zeros_until_ns = None
            return None
        return STANDSTILL
