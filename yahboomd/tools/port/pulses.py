"""Turns single motors by short pulses without regulation, safely even with a broken encoder.

The bounds: a pulse lasts half a second at most, and no wheel turns by more than half a turn, even
if its gear is faster than configured. In all pulses of one call no wheel turns by more than one
turn. A pulse ends when the counters show that the wheel will have turned this far once it has
rolled out. While no counter moves, the fastest existing motor bounds each pulse and all of them
together; a motor that does not move within that is reported as one that did not turn.

A pulse sets an output, never a speed: with a dead or reversed encoder the board's speed loop would
drive the wheel as fast as it can.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Mapping

import msgspec

from yahboomd.core.clock import Clock, nanoseconds, seconds, sleep_until
from yahboomd.core.counts import unwrapped
from yahboomd.core.errors import BoardError
from yahboomd.core.link.handshake import unheard_because
from yahboomd.core.link.line import Line
from yahboomd.core.model import CHANNELS, Counts
from yahboomd.core.protocol.dialect import Dialect
from yahboomd.core.protocol.settings import BoardSettings

CUTS = 3
"""How often each cut is sent, because a frame may be lost."""

LONGEST_S = 0.5

BOUND_TURNS = 0.3
"""A pulse ends at this count: the wheel rolls on, and counts are some milliseconds old."""

TURNS = 0.45
"""A pulse ends before the wheel turns farther, by its counts and by their speed."""

BLIND_TURNS, MOST_BLIND_TURNS = 0.25, 1.0
"""The fastest motor's turns in a pulse that no counter shows, and in all pulses of a call.

A pulse that cannot be as short as that is still done up to :data:`TURNS`.
"""

ROLLS_S = 0.15
"""A wheel that is let go rolls on at most as far as it turned in this time."""

LAG_S = 0.05
"""The quickest motor reaches 63 % of its speed in this time."""

SHORTEST_S = 0.04
"""The shortest pulse: no motor visibly moves in less."""

SHOWN_TURNS = 0.1
"""A person sees a wheel turn if it turns by this much."""

MOST_TURNS = 0.8
"""The pulses of one call end at this count."""

MOST_PULSES = 40

NEAR_SHARE = 0.03
"""An advance is done if this share of it is left."""

MOVED_TURNS = 0.01
"""Less may be the play of the gears."""

SEEN_COUNTS = 3
"""A wheel that counted this much has an encoder that works."""

STEPS = tuple(step / 100.0 for step in range(48, 80, 6))
"""Outputs to try, as shares of the largest one.

Weaker ones turn few motors. While no counter moves, each uses up part of the turns that a call may
cause, and stiff motors would be reported as not turned.
"""

STRONGER = (0.66, 0.72, 0.8, 0.9, 1.0)
"""Outputs for a motor that no weaker one turned, as a person saw: a stiff one, or a low battery."""

BRIEFEST_S = 0.015
"""Even the fastest motor turns a wheel by less than half a turn with full output for this time."""

DEAD_SHARE = 0.33
"""No motor of the vendor's turns with a smaller share of the output."""

UNSEEN_S = 0.6
"""A wheel that no counter shows stops within this time of full output, else in proportion."""

SPEED_NS = 8_000_000
"""A speed is a mean over this time at least, to a new count: counters are renewed every 10 ms."""


class Pulse(msgspec.Struct, frozen=True, kw_only=True):
    """The outcome of a pulse.

    Attributes:
        output: The output, in the dialect's units.
        counts: The change of each counter, until all wheels stood.
        turns: The largest turn that any counter showed.
    """

    output: int
    counts: Counts
    turns: float


class Pulses:
    """Turns single motors of a board that reports its counters unasked.

    Args:
        line: An attended line whose wheels were stopped and whose counters come.
        settings: What the board stores; its dead zone is taken off each output.
        fastest_turns_per_s: No wheel turns faster at full output.
        least_ticks: The fewest counts that a turn of a wheel may have; None: as configured.
        on_pulse: Called with True before each pulse, and with False when the wheels stand again.
    """

    def __init__(
        self,
        line: Line,
        dialect: Dialect,
        settings: BoardSettings,
        *,
        ticks_per_revolution: float,
        fastest_turns_per_s: float,
        least_ticks: float | None = None,
        on_pulse: Callable[[bool], None] = lambda _on: None,
    ) -> None:
        self._line = line
        self._clock: Clock = line.clock
        self._dialect = dialect
        self._settings = settings
        self._shares = [share for share in STEPS if self._is_output(share)]
        self._stronger: dict[int, int] = {}
        self._needs: dict[int, float] = {}
        self._ticks = ticks_per_revolution
        self._least = min(ticks_per_revolution, least_ticks or ticks_per_revolution)
        self._fastest = fastest_turns_per_s
        self._on_pulse = on_pulse
        self._first = self._working = 0
        self._news = asyncio.Event()
        line.on_counts = lambda _: self._news.set()
        # A brake would start the board's speed loop, so the line ends by letting the motors go.
        line.let_go = True

    def has_stronger(self, position: int) -> bool:
        """Whether there are outputs that this motor was not given by :meth:`turn_stronger`."""
        return self._stronger.get(position, 0) < len(STRONGER)

    async def turn_stronger(
        self, position: int, on_step: Callable[[], None] = lambda: None
    ) -> Pulse:
        """Turn a motor that :meth:`turn` did not, with the next larger outputs.

        Call it once a person saw no wheel turn: then the turns that a call may cause begin at zero.

        Returns:
            As :meth:`turn`. :meth:`has_stronger` is false once full output was given.

        Raises:
            BoardError: As :meth:`turn`.
        """
        blind = 0.0
        number, stretch = self._stronger.get(position, 0), 1
        while True:
            share = STRONGER[number]
            limit_s = min(LONGEST_S, stretch * self._brief_s(share))
            on_step()
            pulse, _ = await self._pulse({position: 1}, share, limit_s=limit_s)
            if pulse.turns * self._ticks >= SEEN_COUNTS:
                if pulse.turns >= SHOWN_TURNS or limit_s >= LONGEST_S:
                    self._needs[position] = share
                    return pulse
                stretch *= 2
                continue
            number, stretch = number + 1, 1
            self._stronger[position] = number
            blind += self._turns_unseen(share, limit_s)
            if number == len(STRONGER) or blind + TURNS > MOST_BLIND_TURNS:
                return pulse

    async def turn(self, position: int, on_step: Callable[[], None] = lambda: None) -> Pulse:
        """Turn a motor forward, with more and more output, until a counter moves.

        Args:
            on_step: Called before each pulse, while every wheel stands.

        Returns:
            The last pulse: with the first output that turned a wheel visibly by the counters, or
            with the largest output.

        Raises:
            BoardError: The board reset itself, a wheel does not stop, or no counts come.
        """
        self._stronger.pop(position, None)
        self._needs.pop(position, None)
        counted = blind = 0.0
        pulse: Pulse | None = None
        number, stretch = self._first, 1
        while number < len(self._shares):
            share = self._shares[number]
            limit_s = min(LONGEST_S, stretch * self.limit_s(share))
            most = self._turns_unseen(share, limit_s)
            if stretch == 1 and (most > TURNS or blind + most > MOST_BLIND_TURNS):
                break
            on_step()
            pulse, _ = await self._pulse({position: 1}, share, limit_s=limit_s)
            counted += pulse.turns * self._ticks
            if pulse.turns >= SHOWN_TURNS:
                # The next motor will need about the same output.
                self._first, self._working = max(0, number - 2), number
                break
            if counted >= BOUND_TURNS * self._least:
                break
            if pulse.turns * self._ticks < SEEN_COUNTS:
                blind += most
            elif limit_s < LONGEST_S:
                # The encoder works, but its counts are too rare to extend a pulse this short.
                stretch *= 2
                continue
            number, stretch = number + 1, 1
        if pulse is None:
            raise BoardError(
                f"{self._line.port.name}: the board stores a dead zone of "
                f"{self._settings.get('deadzone')}, so its least output may turn a wheel by more "
                "than half a turn.",
                remedy="Store the motors' own dead zone with `yahboomd probe --write`, or turn the "
                "wheels by hand: `yahboomd setup --by-hand`.",
            )
        return pulse

    @property
    def most_counts(self) -> float:
        """The counts of the longest :meth:`advance`."""
        return MOST_TURNS * self._least

    async def advance(
        self, signs: Mapping[int, int], counts: float, on_step: Callable[[], None] = lambda: None
    ) -> Counts:
        """Turn motors forward until each has counted this much, in several pulses.

        Args:
            signs: The sign of the output for each motor, by its position.
            counts: :attr:`most_counts` at most.
            on_step: Called before each pulse, while every wheel stands.

        Returns:
            The change of each counter in all; less than asked for if a motor does not turn.

        Raises:
            BoardError: The board reset itself, a wheel does not stop, or no counts come.
        """
        counts = min(counts, self.most_counts)
        reached = max((self._needs.get(position, 0.0) for position in signs), default=0.0)
        shares = sorted({*self._shares, *(each for each in STRONGER if each <= reached)})
        # Weak outputs would use up the turns that no counter shows.
        least = min((self._needs.get(position, 0.0) for position in signs), default=0.0)
        number, rolls, blind = shares.index(least) if least else self._working, 0.0, 0.0
        done = (0, 0, 0, 0)
        for _ in range(MOST_PULSES):
            ways = [abs(done[position - 1]) for position in signs]
            left = counts - min(ways)
            if left <= max(rolls, NEAR_SHARE * counts):
                break
            bound = min(left - rolls, self.most_counts - max(ways))
            if bound <= 0.0 or number >= len(shares):
                break
            share = shares[number]
            limit_s = self.limit_s(share)
            if share <= reached:
                limit_s = min(limit_s, self._brief_s(share))
            most = self._turns_unseen(share, limit_s)
            if most > TURNS or (blind and blind + most > MOST_BLIND_TURNS):
                break
            on_step()
            pulse, rolls = await self._pulse(signs, share, bound, limit_s=limit_s)
            if pulse.turns * self._ticks < SEEN_COUNTS:
                blind += most
            done = tuple(map(sum, zip(done, pulse.counts, strict=True)))  # type: ignore[assignment]
            if min(abs(pulse.counts[each - 1]) for each in signs) < MOVED_TURNS * self._least:
                number += 1
        return done

    def limit_s(self, share: float) -> float:
        """The longest pulse of an output while no counter moves."""
        limit_s = SHORTEST_S
        while limit_s < LONGEST_S and self._turns_unseen(share, limit_s + 0.01) <= BLIND_TURNS:
            limit_s += 0.01
        return limit_s

    def _brief_s(self, share: float) -> float:
        """The longest pulse with which the fastest motor turns by less than half a turn."""
        limit_s = SHORTEST_S
        while limit_s > BRIEFEST_S and self._turns_unseen(share, limit_s) > TURNS:
            limit_s -= 0.001
        return limit_s

    def _turns_unseen(self, share: float, pulse_s: float) -> float:
        """The turns of the fastest motor by such a pulse, until it has rolled out.

        It follows an output with a lag of the first order, v (t - T (1 - e^(-t/T))), and rolls on
        from the speed that it has at the end.
        """
        lagged = 1.0 - math.exp(-pulse_s / LAG_S)
        return self._fastest * _effect(share) * (pulse_s + (ROLLS_S - LAG_S) * lagged)

    def _is_output(self, share: float) -> bool:
        """Whether the board can give this output: it adds its own dead zone to each."""
        output = round(share * self._dialect.most_output)
        none = self._dialect.outputs((0, 0, 0, 0), self._settings)
        return self._dialect.outputs((output, 0, 0, 0), self._settings) != none

    async def _pulse(
        self,
        signs: Mapping[int, int],
        share: float,
        bound: float = math.inf,
        *,
        limit_s: float | None = None,
    ) -> tuple[Pulse, float]:
        """Do one pulse; returns it with the distance that the fastest wheel rolled afterwards.

        Args:
            bound: The count at which it ends at the latest.
            limit_s: The longest time while no counter moves; None: :meth:`limit_s`.
        """
        unseen_s = self.limit_s(share) if limit_s is None else limit_s
        # The counters lag behind the wheels by this time.
        age_s = seconds(self._dialect.sample_period_ns or 0)
        # Until the next counts it turns on: the phase of the counters is not known.
        rolls_s = ROLLS_S + 2.0 * age_s
        line, clock, dialect = self._line, self._clock, self._dialect
        output = round(share * dialect.most_output)
        each = [output * signs.get(position, 0) for position in range(1, CHANNELS + 1)]
        bound = min(bound, BOUND_TURNS * self._least)
        motors = " and ".join(f"M{position}" for position in signs)
        resets = line.heard.resets
        before = await self._standing(motors, resets)
        start_ns = clock.now_ns()
        self._on_pulse(True)
        line.writer.velocity(dialect.outputs((each[0], each[1], each[2], each[3]), self._settings))
        then_ns, then = moved_ns, moved = start_ns, 0.0
        try:
            while True:
                now_ns = clock.now_ns()
                self._check_reset(motors, resets)
                turns = self._turns(before)
                seen = turns * self._ticks >= SEEN_COUNTS
                if turns > moved:
                    moved_ns, moved = now_ns, turns
                # Counters that stopped may belong to an encoder that failed while its wheel turns.
                until_ns = (moved_ns if seen else start_ns) + nanoseconds(unseen_s + seen * age_s)
                end_ns = min(until_ns, start_ns + nanoseconds(LONGEST_S))
                if turns * self._ticks >= bound or now_ns >= end_ns:
                    break
                if turns > then and now_ns - then_ns >= SPEED_NS:
                    rolls = (turns - then) / seconds(now_ns - then_ns) * rolls_s
                    if turns + rolls >= TURNS * self._least / self._ticks:
                        break
                    then_ns, then = now_ns, turns
                await self._counted(end_ns)
        finally:
            cut(line, dialect)
        ended = self._turns(before)
        if ended < MOVED_TURNS:
            await sleep_until(clock, clock.now_ns() + nanoseconds(UNSEEN_S * _effect(share)))
        after = await self._standing(motors, resets)
        self._on_pulse(False)
        a, b, c, d = (unwrapped(new - old) for new, old in zip(after, before, strict=True))
        turns = self._turns(before)
        return Pulse(output=output, counts=(a, b, c, d), turns=turns), (turns - ended) * self._ticks

    def _turns(self, before: Counts) -> float:
        ticks = self._line.ticks
        assert ticks is not None
        steps = (unwrapped(new - old) for new, old in zip(ticks, before, strict=True))
        return max(map(abs, steps)) / self._ticks

    def _check_reset(self, motors: str, resets: int) -> None:
        if self._line.heard.resets != resets:
            raise BoardError(
                f"{self._line.port.name}: the board reset itself while {motors} was tried.",
                remedy="Its supply is too weak: feed the motors from a battery, not from USB, and "
                "charge it.",
            )

    async def _standing(self, motors: str, resets: int) -> Counts:
        """Wait until every wheel stands; returns the counters."""
        line = self._line
        report = await line.rest(self._dialect, leave=False)
        self._check_reset(motors, resets)
        if report.stood is None:
            raise BoardError(
                f"{line.port.name}: {motors} was let go, and no counts come.",
                remedy=unheard_because(line),
            )
        if not report.stood:
            raise BoardError(
                f"{line.port.name}: {motors} was let go, and a wheel turns.",
                remedy="Take your hands off the wheels. If one turns by itself, switch the "
                "motors' supply off: its driver may be broken.",
            )
        assert line.ticks is not None
        return line.ticks

    async def _counted(self, until_ns: int) -> None:
        """Wait for the next counts, at most until ``until_ns``."""
        self._news.clear()
        alarm = self._clock.alarm(self._news.set)
        alarm.set(until_ns)
        try:
            await self._news.wait()
        finally:
            alarm.close()


def cut(line: Line, dialect: Dialect) -> None:
    """Let the motors go before everything else; a dialect without a cut brakes instead."""
    line.writer.stop((dialect.cut or dialect.brake,) * CUTS)


def _effect(share: float) -> float:
    """The speed of the motor that starts most easily, as a share of its largest."""
    return max(0.0, (share - DEAD_SHARE) / (1.0 - DEAD_SHARE))
