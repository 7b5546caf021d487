"""Wheels that turn in the air for a measurement, checked at each reading.

Wheels turn only while each reading is checked, for a bounded time, with a second process that stops
them if this one dies (:mod:`yahboomd.tools.port.guard`). A wheel that turns against its command,
faster than commanded, or not at all, ends the measurement with the motors cut. Lines have no
checksum, so a single reading proves no fault: checks use the median of the latest three.
"""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable
from functools import partial
from statistics import median_low
from typing import Self

from yahboomd.core.clock import Clock, nanoseconds, seconds, sleep_until
from yahboomd.core.config import Config
from yahboomd.core.counts import unwrapped
from yahboomd.core.errors import BoardError, BoardSilent
from yahboomd.core.link.conversation import Conversation
from yahboomd.core.link.handshake import unheard_because
from yahboomd.core.link.line import Line
from yahboomd.core.link.port import Opener
from yahboomd.core.model import CHANNELS, NS_PER_S, Counts, EncoderReading, Motor
from yahboomd.core.protocol.dialect import Dialect, Motion
from yahboomd.core.protocol.settings import BoardSettings
from yahboomd.tools.port.board_questions import read_battery, read_counters
from yahboomd.tools.port.guarded import GuardedPort, guarded
from yahboomd.tools.port.pulses import cut
from yahboomd.tools.tune import wheel_faults
from yahboomd.tools.tune.estimates.dead_zone import MOVED_COUNTS, Ramp, RampSample
from yahboomd.tools.tune.line_faults import LineFault, line_blamed
from yahboomd.tools.tune.traces import Traces, traces_of
from yahboomd.tools.tune.wheel_faults import WheelFault

LOOK_NS = 10_000_000
BEAT_NS = 200_000_000
POLL_NS = 20_000_000
POLL_TIMEOUT_NS = 100_000_000

SILENT_NS = 800_000_000
STILL_TICKS_PER_S = 20.0
"""One count more or less in the window. A wheel that still rolls out would show as motion later."""

RISE_UNITS_PER_S = 800.0
RISE_TURNS = 0.15
"""A rise ends when the wheel has turned this far."""

FALL_UNITS_PER_S = 50.0
FALL_UNITS_PER_TURN = 150.0
"""The output falls by these: slowly at the end, because a wheel lags behind its output."""

FALL_WITHIN_S = 15.0
STOPPED_S = 0.2
HOLD_S = 1.5
HELD_ABOVE = 300
"""Where the least output turns the wheel, it is held, and another one this much above it."""


class Stand:
    """A known board whose wheels are in the air.

    Attributes:
        settings: The stored settings; None if the board stores none.
        volts: The supply; None if the board does not report it.
        may_stand: A wheel that stands in a step is no fault: the ramps have shown that it turns,
            and that the stored dead zone may be too small to start it.

    Args:
        guard: Stops the wheels if this process dies or the port goes away.
    """

    def __init__(
        self,
        line: Line,
        dialect: Dialect,
        motors: tuple[Motor, ...],
        motion: Motion,
        guard: GuardedPort,
    ) -> None:
        self.dialect = dialect
        self.settings: BoardSettings | None = None
        self.motors = motors
        self.volts: float | None = None
        self.may_stand = False
        self._line = line
        self._clock: Clock = line.clock
        self._motion = motion
        self._guard = guard
        self._wheels = len(motion.wheel_limits)
        self._samples: list[tuple[int, Counts]] = []
        self._latest: deque[Counts] = deque(maxlen=3)
        self._first: Counts = (0, 0, 0, 0)
        self._heard_ns = 0
        self._problem = ""
        self._expected: tuple[float, ...] | None = None
        self._began_ns = 0
        self._resets = line.heard.resets
        line.on_counts = self._on_counts

    @classmethod
    @contextlib.asynccontextmanager
    async def open(
        cls,
        opener: Opener,
        clock: Clock,
        config: Config,
        say: Callable[[str], None] = lambda _words: None,
    ) -> AsyncIterator[Self]:
        """Stop the wheels, identify the board, and start its counters.

        Args:
            say: Shows a message to a person.

        Raises:
            LostInMotion: The port went away while wheels turned.
            BoardError: Its stored settings forbid motion, or the line damages bytes.
            LinkError: The port cannot be opened, or no board answers.
        """
        port = await opener()
        line = Line(port, clock, still_ticks_per_s=STILL_TICKS_PER_S)
        async with guarded(line, say) as guard, line.attended():
            talk = await Conversation.begin(line)
            dialect = talk.dialect.for_profile(config.profile())
            settings = await talk.read_settings(config.profile().settings)
            if settings is not None:
                found = dialect.findings(settings, config.profile())
                if problems := (*found.unfit, *found.wrong):
                    raise BoardError(f"{line.port.name}: {' '.join(problems)}")
            motors = config.motors()
            motion = dialect.motion(
                config.kinematics(), motors, settings, scale=config.chassis.command_scale
            )
            await guard.watch_over(dialect)
            try:
                async with line_blamed(line, dialect):
                    stand = cls(line, dialect, motors, motion, guard)
                    stand.settings = settings
                    stand.volts = await read_battery(talk)
                    # A brake would start the board's speed loop again.
                    line.let_go = dialect.cut is not None
                    for frame in dialect.arm:
                        line.writer.queue(frame)
                    if await read_counters(talk) is None:
                        raise BoardSilent(
                            f"{line.port.name}: the board sends no counters.",
                            remedy=unheard_because(line),
                        )
                    if dialect.poll is not None:
                        line.tasks.start(stand._poll(dialect.poll), "poll")
                    await stand._stand()
                    yield stand
                    await stand._stand()
            finally:
                line.writer.quiet()

    @property
    def top_m_s(self) -> float:
        """The fastest command that every wheel can follow."""
        return min(self._motion.wheel_limits)

    @property
    def ticks_apart_s(self) -> float:
        """The time from one renewal of the counts to the next."""
        return (self.dialect.sample_period_ns or POLL_NS) / NS_PER_S

    def units(self, speed_m_s: float) -> float:
        """A speed of all wheels in the board's units."""
        return max(map(abs, self._motion.units((speed_m_s,) * self._wheels)))

    @property
    def damages(self) -> int:
        """The number of chunks that arrived damaged lately."""
        return self._line.damages

    @property
    def noisy(self) -> bool:
        """Whether the line damages too many bytes to measure."""
        return self._line.noisy

    def line_fault(self) -> LineFault:
        """The error of a line over which nothing can be measured."""
        return LineFault.of(self._line)

    async def ramp(self, motor: Motor, way: int, *, down: bool) -> tuple[Ramp, Ramp]:
        """Raise one motor's output slowly until it has turned; the others stay off.

        Args:
            way: +1 forward, -1 backward.
            down: Lower the output then until the wheel stops.

        Returns:
            The rise and the fall of the output. The fall is empty unless asked for; where even the
            least output turns the wheel, it ends with that one and a larger one, held.

        Raises:
            WheelFault: Another wheel turned too, or it turned the wrong way, or not at all.
            BoardError: The board reset itself, or a wheel does not stop.
        """
        first = await self._stand()
        rise: Ramp = []
        fall: Ramp = []
        async with self._driven(None):
            start_ns = self._clock.now_ns()
            at = partial(self._at_output, motor, way, first=first, start_ns=start_ns)
            output = 0.0
            while not rise or rise[-1].counts < RISE_TURNS * motor.ticks_per_revolution:
                if output >= self.dialect.most_output:
                    raise WheelFault(
                        f"{motor.name} (M{motor.position}) does not count at full output.",
                        remedy="Look at its cable, at the supply of the motors, and whether the "
                        "wheel is free.",
                    )
                output = RISE_UNITS_PER_S * seconds(self._clock.now_ns() - start_ns)
                rise.append(await at(output))
            if down:
                fall = await self._lower(motor, at, rise[-1])
        return rise, fall

    async def _lower(
        self, motor: Motor, at: Callable[[float], Awaitable[RampSample]], last: RampSample
    ) -> Ramp:
        """Lower an output until the wheel stops, or hold the two that are nearest to that.

        Args:
            at: Gives the motor an output.
            last: The end of the rise.
        """
        fall: Ramp = []
        stored = (self.settings or {}).get("deadzone")
        least = 1 + (stored if isinstance(stored, int) else 0)
        output, moved, speed = float(last.output), last, 0.0
        while output > least and last.at_s - moved.at_s < STOPPED_S:
            rate = FALL_UNITS_PER_S + FALL_UNITS_PER_TURN * speed / motor.ticks_per_revolution
            before = fall[-5:][0] if fall else last
            last = await at(output)
            fall.append(last)
            speed = max(0.0, (last.counts - before.counts) / (last.at_s - before.at_s))
            output = max(least, output - rate * LOOK_NS * 2 / NS_PER_S)
            if last.counts > moved.counts:
                moved = last
            if last.at_s - fall[0].at_s > FALL_WITHIN_S:
                break
        if last.at_s - moved.at_s >= STOPPED_S or output > least:
            return fall
        for held in (least, min(least + HELD_ABOVE, self.dialect.most_output)):
            begun = last
            while last.at_s - begun.at_s < HOLD_S:
                last = await at(held)
                fall.append(last)
            if last.counts - begun.counts < MOVED_COUNTS:
                # The wheel stopped just there.
                break
        return fall

    async def _at_output(
        self, motor: Motor, way: int, output: float, *, first: Counts, start_ns: int
    ) -> RampSample:
        """Give one motor an output for two looks, and check what turned."""
        dialect, position = self.dialect, motor.position
        given = min(dialect.most_output, round(output))
        signed = given * motor.command_sign * way
        a, b, c, d = (signed if place == position else 0 for place in range(1, CHANNELS + 1))
        self._line.writer.velocity(dialect.outputs((a, b, c, d), self.settings or {}))
        await self._look(2 * LOOK_NS)
        counts = self._counts_since(first)
        own = counts[position - 1] * motor.encoder_sign * way
        wheel_faults.check_alone(motor, self.motors, counts)
        if own < -wheel_faults.TOUCHED_COUNTS:
            raise WheelFault(
                f"{motor.name} (M{position}) counts {'down' if way > 0 else 'up'} while it "
                f"is driven {'forward' if way > 0 else 'backward'}: with regulation it "
                "would run away.",
                remedy="Set its signs, or swap the wires of its encoder: see `yahboomd "
                "probe` and the page on setting up.",
            )
        at_s = seconds(self._clock.now_ns() - start_ns)
        return RampSample(at_s, given, own)

    async def step(self, speed_m_s: float, hold_s: float) -> Traces:
        """Turn every wheel by one step from rest, and stop it again.

        Args:
            speed_m_s: Of the rims; negative backward.

        Raises:
            WheelFault: A wheel does not follow.
            BoardError: The board reset itself, or a wheel does not stop.
        """
        first = await self._stand()
        frame = self.dialect.speeds(self._motion.units((speed_m_s,) * self._wheels))
        async with self._driven((speed_m_s,) * len(self.motors)):
            self._samples = []
            start_ns = self._clock.now_ns() + len(frame) * self._line.port.byte_ns
            self._line.writer.velocity(frame)
            # The last reading must be later than the last tick of the grid.
            await self._look(nanoseconds(hold_s + 2.0 * self.ticks_apart_s))
            samples = self._samples.copy()
        return traces_of(
            self.dialect,
            self.motors,
            [(at_ns - start_ns, counts) for at_ns, counts in samples],
            first,
            apart_s=self.ticks_apart_s,
            speed_m_s=speed_m_s,
            hold_s=hold_s,
        )

    async def excuses(self, times: int) -> bool:
        """Whether the line, not a wheel, may have caused another fault; the wheels stand then.

        Each recently damaged chunk excuses one fault: chance does not repeat itself.

        Args:
            times: The number of faults already excused; below 0 excuses some without damage.

        Raises:
            BoardError: A wheel does not stop.
        """
        if self.noisy or times >= self.damages:
            return False
        await self._stand()
        self._mark(driven=False)
        return True

    # Watching.

    @contextlib.asynccontextmanager
    async def _driven(self, expected: tuple[float, ...] | None) -> AsyncIterator[None]:
        """Check wheels that turn, cut them at the end, and wait for them to stand unless it failed.

        Args:
            expected: The speed of each motor; None while one is driven without regulation.
        """
        self._problem = ""
        self._first = self._line.ticks or self._first
        self._expected = expected
        self._began_ns = self._heard_ns = self._clock.now_ns()
        self._mark(driven=True)
        try:
            yield
        finally:
            # After a failure the line stops them, and the guard stays awake until it has.
            self._cut()
        await self._stand()
        self._mark(driven=False)

    def _mark(self, *, driven: bool) -> None:
        self._guard.mark(driven)

    async def _look(self, ns: int) -> None:
        """Wait, and check every 10 ms for faults, resets and silence."""
        end_ns = self._clock.now_ns() + ns
        beat_ns = 0
        while True:
            now_ns = self._clock.now_ns()
            if self._problem:
                raise WheelFault(self._problem)
            if self._line.heard.resets != self._resets:
                raise BoardError(
                    f"{self._line.port.name}: the board reset itself while wheels turned.",
                    remedy="Its supply is too weak: feed the motors from a battery, and charge it.",
                )
            if now_ns - self._heard_ns > SILENT_NS:
                raise self._silent()
            if now_ns >= end_ns:
                return
            if now_ns >= beat_ns:
                self._mark(driven=True)
                beat_ns = now_ns + BEAT_NS
            await sleep_until(self._clock, min(end_ns, now_ns + LOOK_NS))

    def _on_counts(self, reading: EncoderReading) -> None:
        self._heard_ns = self._clock.now_ns()
        self._samples.append((reading.sent_ns, reading.ticks))
        self._latest.append(reading.ticks)
        if self._expected is not None and not self._problem:
            self._problem = self._wrong(self._expected, self._first)
            if self._problem:
                self._cut()

    def _wrong(self, expected: tuple[float, ...], first: Counts) -> str:
        counted = self._counts_since(first)
        waited_s = seconds(self._clock.now_ns() - self._began_ns)
        ramped = bool(self.dialect.most_output)
        return wheel_faults.found(
            self.motors, expected, counted, waited_s, ramped=ramped, may_stand=self.may_stand
        )

    def _counts_since(self, first: Counts) -> Counts:
        each = zip(*self._latest, strict=True)
        a, b, c, d = (
            median_low(unwrapped(new - old) for new in latest)
            for latest, old in zip(each, first, strict=True)
        )
        return a, b, c, d

    def _silent(self) -> BoardSilent:
        return BoardSilent(
            f"{self._line.port.name}: the motors were cut, and no counts come: whether the wheels "
            "stand is not known.",
            remedy="Look at the wheels, then at the supply and the cable. Try `yahboomd probe`.",
        )

    def _cut(self) -> None:
        self._expected = None
        self._line.writer.quiet()
        cut(self._line, self.dialect)

    async def _stand(self) -> Counts:
        """Wait until every wheel stands; return the counters then."""
        line = self._line
        report = await line.rest(self.dialect, leave=False)
        if not report.stood:
            if self._clock.now_ns() - self._heard_ns > SILENT_NS:
                raise self._silent()
            raise BoardError(
                f"{line.port.name}: the motors are cut, and a wheel still turns.",
                remedy="Switch the supply of the motors off.",
            )
        assert line.ticks is not None
        return line.ticks

    async def _poll(self, frame: bytes) -> None:
        while True:
            self._line.writer.poll(frame, POLL_TIMEOUT_NS)
            await sleep_until(self._clock, self._clock.now_ns() + POLL_NS)
