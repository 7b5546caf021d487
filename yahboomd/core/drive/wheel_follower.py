"""Decides whether one wheel follows its setpoint.

A healthy motor lags behind. So a measurement is compared not with the present setpoint but with
every speed at which a healthy motor may turn by now: an envelope. It follows a growing setpoint at
once, and a falling one with the slowest plausible time constant. (Any first-order lag up to that
stays inside, because ``y' = (u - y) / tau`` falls faster than the envelope wherever they meet.)

A wheel without counts is judged by its history. One that rolled as commanded and then has no counts
from one reading to the next is broken or blocked. One that stands may stick to the floor: the
board's loop winds up until it breaks away. Such a wheel has time until it would have turned too far
unseen if its encoder were dead; soon after full output at the latest. Then the wheels are let go,
and the third time without a count is a fault.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

import msgspec

from yahboomd.core.counts import slowest
from yahboomd.core.drive.faults import Action, Fault, FaultKind
from yahboomd.core.drive.loop_law import LoopLaw, loop_law
from yahboomd.core.model import NS_PER_S
from yahboomd.core.standstill import STANDING_M_S

SLOWEST_LAG_S = 0.4
RESTING_M_S = 0.001
"""A setpoint is over once its remaining effect is smaller than this."""
SPEED_FACTOR = 1.5
SPEED_MARGIN_M_S = 0.1
# A wheel must be cut within 150 ms of leaving its envelope. The reading takes up to one poll period
# of these, and the velocity's filter a few milliseconds. The remaining 40 ms exclude a single
# garbled reading.
SURE_AFTER_NS = 40_000_000
# A motor slower than any plausible one still obeys if it loses speed at this rate: a time constant
# of a second. A motor that runs away gains speed, or keeps it.
SLOWED = 0.96
SLOWS_FOR_NS = 500_000_000
# A wheel that rolls and is held again gains speed until the board's loop outweighs the slope.
PULLED_M_S = 0.5
CREEPING_NS = 600_000_000
OFF_SPEED_NS, OFF_SPEED_RATIO = 1_000_000_000, 0.5
GAP_NS = 500_000_000
MOST_SETPOINTS = 500
"""Kept between two readings."""

NO_COUNTS_NS, NO_COUNTS_M = 150_000_000, 0.03
ROLLED = 0.5
"""A wheel at this share of its setpoint, or more, did not stop by itself."""
COUNTED_NS = 20_000_000
# While the line stands still in both directions, a wheel shows and obeys nothing. The time is
# limited, so that a stuttering line does not hide a dead encoder.
HELD_UP_NS = 1_000_000_000
# An encoder that rests on an edge may flicker by one count for ever.
COUNTS_OF_MOTION = 2

SILENCE: frozenset[FaultKind] = frozenset({"no_counts", "not_started"})
TRIES = 3
TOP_M_S = 1.2
"""The speed of a free wheel at full output."""
UNSEEN_SHARE = 0.05
"""A wheel may break away at so much less output than expected."""
EASY_SHARE = 0.13
"""Wheels that need no output of the loop may need less than the stored dead zone by so much."""
LEAPS = 0.5
"""A wheel that breaks away turns as fast as one that needs this share of the output."""
LEAP_M_S = 0.4
LEAPS_FOR_NS = 800_000_000
"""The loop takes back for so long what it added to move the wheel."""
ROLLS_OUT_S = 0.3
"""A wheel that is let go rolls on for its speed times this."""
UNSEEN_M = (0.3, 0.4, 0.5)
"""The way that a wheel may have turned unseen until it stands, in this try and those before."""
ALL_UNSEEN_M = (0.8, 0.9, 1.0)
"""The same while no other wheel turns: most floors hold all wheels for so long."""
OTHERS_STAND_M = 0.005
TURNING_ROUND = 2
"""A loop that turned the wheel the other way has twice the output to cover."""


class Step(msgspec.Struct, frozen=True, kw_only=True):
    """What a reading shows of all wheels.

    Attributes:
        before_ns: When the board sampled the previous reading.
        now_ns: When it sampled this one.
        law: How the board's loop winds up.
        farthest_m: The farthest that any wheel travelled meanwhile.
        starts_at: The least output at which a wheel began to turn.
    """

    before_ns: int
    now_ns: int
    law: LoopLaw = loop_law({})
    farthest_m: float = 0.0
    starts_at: float = 0.0


class WheelFollower:
    """Compares one wheel's readings with its setpoints.

    Args:
        min_speed_m_s: Below this setpoint, missing counts of a wheel that rolled prove nothing.
        latency_ns: From sending a setpoint to the first reading that can show it.
        witnessed: Returns the speed that several readings agree on, which a cut requires; ``None``
            if they are too few.

    Attributes:
        owed_m: The commanded travel since its last counts; metres of the rim.
        started: Whether it counted since it was commanded in this direction.
        starts_at: The loop's output at which it last began to turn; None if unknown.
    """

    def __init__(
        self,
        name: str,
        min_speed_m_s: float,
        latency_ns: int,
        metres_per_tick: float,
        witnessed: Callable[[], float | None],
    ) -> None:
        self.name = name
        self._metre = metres_per_tick
        self._witnessed = witnessed
        self._min_speed_m_s = min_speed_m_s
        self._latency_ns = latency_ns
        self.commanded_m_s: float | None = None
        self.starts_at: float | None = None
        # Each entry is the setpoint in force until its stamp.
        self._past: deque[tuple[int, float]] = deque(maxlen=MOST_SETPOINTS)
        self._let_go = self.started = False
        self._tries, self._unseen_m = 0, [0.0, 0.0]
        self.begin(0.0)

    def begin(self, measured_m_s: float) -> None:
        """Start with an envelope from standstill to this speed and to the setpoint."""
        commanded = self.commanded_m_s or 0.0
        self._past.clear()
        self._high = max(0.0, measured_m_s, commanded)
        self._low = min(0.0, measured_m_s, commanded)
        self.measured_m_s = measured_m_s
        self._paces: deque[float] = deque(maxlen=2)
        self._rolled = self._leaps_until_ns = self._left_ns = 0
        self._outside_m_s = 0.0
        self._since_ns: dict[FaultKind, int] = {}
        self._known: set[FaultKind] = set()
        self._owe_nothing()

    def _owe_nothing(self) -> None:
        self.owed_m = self._owed_signed_m = self._silent_m = self._others_m = 0.0
        self._owed_ticks = self._owed_ticks_before = 0
        # A step that ends with counts was no silence, even if they were held back for long.
        self._silent_ns = self._stands_ns = self._held_up_ns = 0

    def command(self, now_ns: int, speed_m_s: float | None) -> None:
        """Record a setpoint that was sent to the board; ``None`` if the motor was let go."""
        before = self.commanded_m_s
        if speed_m_s == before:
            return
        self.commanded_m_s = speed_m_s
        if not before or (speed_m_s and speed_m_s * before < 0.0):
            self.started = False
        if before is not None:
            self._past.append((now_ns, before))
            self._let_go = speed_m_s is None
            return
        # The wheel coasted, so it starts from any speed up to the latest measured.
        self.begin(self.measured_m_s)
        if self._let_go and not speed_m_s:
            self._high += PULLED_M_S
            self._low -= PULLED_M_S
        self._past.append((now_ns, 0.0))

    def measure(
        self, step: Step, speed: float, ticks: int, proven: float, *, held_up: bool = False
    ) -> list[Fault]:
        """Judge a reading.

        Args:
            speed: Measured rim speed, positive forward; m/s.
            proven: The least that the speed can be; no wheel is cut for more.
            held_up: The line was held up, so the setpoint may not have arrived.

        Returns:
            The troubles that began with this reading.
        """
        self.measured_m_s = speed
        if self.commanded_m_s is None:
            return []
        # A reading also shows setpoints that were replaced since the previous one.
        now_ns, step_ns = step.now_ns, step.now_ns - step.before_ns
        while self._past and self._past[0][0] < min(now_ns - self._latency_ns, step.before_ns):
            self._past.popleft()
        shown = [self.commanded_m_s, *(setpoint for _, setpoint in self._past)]
        low, high = min(shown), max(shown)
        fall = -math.expm1(-step_ns / NS_PER_S / SLOWEST_LAG_S)
        self._high = high if high >= self._high else self._high + (high - self._high) * fall
        self._low = low if low <= self._low else self._low + (low - self._low) * fall
        steady = slowest(low, high)
        if ticks:
            self._paces.append(abs(ticks * self._metre) * NS_PER_S / step_ns)
        excused = held_up and self._held_up_ns < HELD_UP_NS
        self._held_up_ns += step_ns if excused else 0
        seen_ns = 0 if excused else step_ns
        self._others_m += step.farthest_m
        self._count(seen_ns, steady, ticks, step)
        rolled = self.started and max(self._paces, default=0.0) >= ROLLED * abs(steady)
        abrupt = rolled and abs(steady) >= self._min_speed_m_s
        found = (
            self._runaway(now_ns, proven),
            self._creeping(now_ns, step_ns, speed),
            self._silence() if abrupt else self._standstill(seen_ns, steady, step),
            self._off_speed(now_ns, speed),
        )
        return [fault for fault in found if fault is not None]

    @property
    def rests(self) -> bool:
        """Whether another reading without a count shows nothing new."""
        still = not self._past and -RESTING_M_S < self._low <= self._high < RESTING_M_S
        return self.commanded_m_s is None or (not self.commanded_m_s and still)

    @property
    def silent(self) -> bool:
        """Whether it is commanded, and has no counts."""
        return bool(self._known & SILENCE) or self.owed_m >= NO_COUNTS_M / 2

    def _lasts(self, kind: FaultKind, now_ns: int, *, now: bool) -> int | None:
        """How long a trouble lasts that is there ``now``; None if it is not."""
        if now:
            return now_ns - self._since_ns.setdefault(kind, now_ns)
        self._since_ns.pop(kind, None)
        self._known.discard(kind)
        return None

    def _leaps(self, now_ns: int, speed: float) -> bool:
        along = speed * (self.commanded_m_s or 0.0) > 0.0
        return along and now_ns < self._leaps_until_ns and abs(speed) <= LEAP_M_S

    def _runaway(self, now_ns: int, speed: float) -> Fault | None:
        most = SPEED_FACTOR * max(self._high, 0.0) + SPEED_MARGIN_M_S
        least = SPEED_FACTOR * min(self._low, 0.0) - SPEED_MARGIN_M_S
        # If every healthy motor turns forward by now, backward needs only the margin of standing.
        most = STANDING_M_S if self._high <= -STANDING_M_S else most
        least = -STANDING_M_S if self._low >= STANDING_M_S else least
        commanded = self.commanded_m_s or 0.0
        inside = least <= speed <= most or self._leaps(now_ns, speed)
        fast_ns = self._lasts("runaway_fast", now_ns, now=not inside)
        if fast_ns is None:
            self._known.discard("runaway_against")
            return None
        if not fast_ns:
            self._left_ns, self._outside_m_s = now_ns, abs(self.measured_m_s)
        if fast_ns < SURE_AFTER_NS:
            return None
        slows = abs(self.measured_m_s) <= SLOWED * self._outside_m_s
        if slows and now_ns - self._left_ns < SLOWS_FOR_NS:
            # It has to lose as much again.
            self._since_ns["runaway_fast"] = now_ns
            self._outside_m_s = abs(self.measured_m_s)
            return None
        agreed = self._witnessed()
        accused = self._known & {"runaway_against", "runaway_fast"}
        if accused or agreed is None or least <= agreed <= most:
            return None
        against = speed * commanded < 0.0
        return self._new("runaway_against" if against else "runaway_fast", speed, "cut")

    def _creeping(self, now_ns: int, step_ns: int, speed: float) -> Fault | None:
        kind: FaultKind = "turns_without_command"
        still = self._high < STANDING_M_S and self._low > -STANDING_M_S
        turns = still and abs(speed) >= STANDING_M_S and not self._leaps(now_ns, speed)
        turns_ns = self._lasts(kind, now_ns, now=turns)
        if (
            turns_ns is not None
            and abs(speed) - abs(slowest(speed, self.commanded_m_s or 0.0)) < STANDING_M_S
        ):
            # Commanded to creep, it may do so faster: a slow motor swings about its setpoint.
            self._since_ns[kind] += min(step_ns, turns_ns)
            return None
        return self._new(kind, speed) if (turns_ns or 0) >= CREEPING_NS else None

    def _count(self, step_ns: int, steady: float, ticks: int, step: Step) -> None:
        """Follow the counts, and what is commanded since the last ones."""
        self._owed_ticks_before = self._owed_ticks
        self._owed_ticks += ticks
        # The board's loop adds up the way with its sign.
        step_m = steady * step_ns / NS_PER_S
        self._owed_signed_m += step_m
        self.owed_m += abs(step_m)
        # Motion in either direction counts: a wheel that rolls out after a change of direction is
        # not silent, and a wheel that turns against its setpoint is found by its speed. Two
        # readings must agree, because a garbled digit is no motion.
        if min(abs(self._owed_ticks), abs(self._owed_ticks_before)) >= COUNTS_OF_MOTION:
            before, self._rolled = self._rolled, self._owed_ticks
            if not self.started and self._rolled * steady > 0.0:
                self.started = True
                # After a reversal the output is a guess; a wheel that rolls on needs no start.
                if not before or (self.starts_at is None and before * steady < 0.0):
                    output = step.law.output(self._owed_signed_m, steady)
                    self.starts_at = output / (TURNING_ROUND if before else 1)
            stood = abs(self._owed_ticks * self._metre) < ROLLED * self.owed_m
            if stood and step.law.output(self._owed_signed_m, 0.0) >= UNSEEN_SHARE:
                self._leaps_until_ns = step.now_ns + LEAPS_FOR_NS
            self._owe_nothing()
            self._known -= SILENCE
            self._tries, self._unseen_m = 0, [0.0, 0.0]
            step_ns = min(step_ns, COUNTED_NS) if ticks else step_ns
        if abs(steady) < self._min_speed_m_s:
            step_ns, self._silent_ns, self._silent_m = 0, 0, 0.0
        self._silent_ns += step_ns
        self._silent_m += abs(steady) * step_ns / NS_PER_S

    def _silence(self) -> Fault | None:
        """A wheel that rolled, and has no counts from one reading to the next, is at fault."""
        silent = self._silent_ns >= NO_COUNTS_NS and self._silent_m >= NO_COUNTS_M
        found = silent and not self._counts_arrive()
        return self._new("no_counts", self.measured_m_s) if found else None

    def _counts_arrive(self) -> bool:
        # Counts that were held back arrive in one reading: the next one tells whether they are
        # motion or a garbled digit.
        return abs(self._owed_ticks) >= COUNTS_OF_MOTION > abs(self._owed_ticks_before)

    def _standstill(self, step_ns: int, steady: float, step: Step) -> Fault | None:
        """Give a wheel that stands the time that its board's loop needs."""
        times = TURNING_ROUND if self._rolled * self._owed_signed_m < 0.0 else 1
        expected = times * (step.starts_at if self.starts_at is None else self.starts_at)
        output = step.law.output(self._owed_signed_m, steady)
        alone = self._others_m < OTHERS_STAND_M
        share = max(UNSEEN_SHARE, min(1.0, output) - LEAPS * expected)
        share += EASY_SHARE if expected < UNSEEN_SHARE and not alone else 0.0
        turns = steady and output >= expected - UNSEEN_SHARE
        speed_m_s = share * TOP_M_S if turns else 0.0
        self._unseen_m[alone] += speed_m_s * step_ns / NS_PER_S
        way_m = self._unseen_m[alone] + speed_m_s * ROLLS_OUT_S
        most_m = (ALL_UNSEEN_M if alone else UNSEEN_M)[self._tries]
        # One that turns round, quick as its board's loop may be, passes through rest.
        self._stands_ns += step_ns if steady else 0
        if way_m < most_m or self._stands_ns < times * NO_COUNTS_NS // 3 or self._counts_arrive():
            return None
        self._unseen_m[alone] = way_m
        return self.give_up()

    def give_up(self) -> Fault | None:
        """End this try to turn it; the last one is a fault."""
        if self._known & SILENCE:
            return None
        self._tries += 1
        if self._tries < TRIES:
            return self._new("not_started", self.measured_m_s, "let_go")
        self._tries, self._unseen_m = 0, [0.0, 0.0]
        return self._new("no_counts", self.measured_m_s, certain=True)

    def _off_speed(self, now_ns: int, speed: float) -> Fault | None:
        least = abs(slowest(self._low, self._high))
        slow = least >= self._min_speed_m_s and abs(speed) < OFF_SPEED_RATIO * least
        # A wheel that stands is judged by its silence.
        slow_ns = self._lasts("off_speed", now_ns, now=slow and not self.silent)
        if slow_ns is None or slow_ns < OFF_SPEED_NS or not speed:
            return None
        return self._new("off_speed", speed, "report")

    def _new(
        self, kind: FaultKind, measured: float, action: Action = "policy", *, certain: bool = False
    ) -> Fault | None:
        if kind in self._known:
            return None
        self._known.add(kind)
        commanded = self.commanded_m_s or 0.0
        words = _THREE_TRIES if certain else _MESSAGES[kind]
        return Fault(
            kind=kind,
            motor=self.name,
            message=words.format(self.name, commanded, measured, abs(commanded)),
            action=action,
            commanded_m_s=commanded,
            measured_m_s=measured,
            certain=certain,
        )


_THREE_TRIES = (
    "{0} had no counts in three tries, the last at {3:.2f} m/s: check whether the wheel turns "
    "freely, then the plug of motor and encoder, and the position."
)
_MESSAGES: dict[FaultKind, str] = {
    "runaway_against": "{0} turns at {2:.2f} m/s against its command of {1:.2f} m/s: check that "
    "the encoder's phases are not swapped, the motor's polarity, and command_sign and "
    "encoder_sign of this position.",
    "runaway_fast": "{0} turns at {2:.2f} m/s where {1:.2f} m/s are commanded: check the "
    "encoder's plug, and that the board's motor type, lines, ratio and diameter fit the motor; "
    "or the wheel was pushed, or came free after being blocked.",
    "turns_without_command": "{0} turns at {2:.2f} m/s without command: check whether the robot "
    "is pushed or stands on a slope, the encoder's plug, and that a motor sits at this position.",
    "no_counts": "{0} turned, is commanded {1:.2f} m/s, and its encoder shows no motion any more: "
    "check whether the wheel is blocked, then the plug of motor and encoder, and the motor supply.",
    "not_started": "{0} does not begin to turn at {3:.2f} m/s: drive faster",
    "off_speed": "{0} turns at {2:.2f} m/s where {1:.2f} m/s are commanded: check the load, the "
    "battery, and that the profile and command_scale fit the motor.",
}
