"""Compares the commands of one motor with its motion.

Healthy motors do not follow at once: they start after 0.02 to 0.4 s and lag behind. So a
measurement is compared not with the present command but with every speed at which a healthy motor
may turn by now: an envelope. It follows a growing command at once, and a falling one with the
slowest plausible time constant. (Any first-order lag up to that stays inside, because ``y' = (u -
y) / tau`` falls faster than the envelope wherever they meet.)
"""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING

from yahboomd.core.counts import slowest
from yahboomd.core.drive.faults import Fault
from yahboomd.core.model import NS_PER_S, STANDING_M_S

if TYPE_CHECKING:
    from collections.abc import Callable

    from yahboomd.core.drive.faults import Action, FaultKind

SLOWEST_LAG_S = 0.4
RESTING_M_S = 0.001
"""A command is over once its remaining effect is smaller than this."""
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
NO_COUNTS_NS = 150_000_000
NO_COUNTS_M = 0.03
# A wheel that rolled the other way before takes twice as long to start, because the output of the
# board's loop starts at the far edge of the motor's dead zone.
TURNING_ROUND = 2
# If no wheel counts, or each was slow to, the motors may be stiffer than the stored dead zone,
# and the loop has to add up the rest: 49 mm at 0.06 m/s for one that turns at 54 % of the output.
SLOW_M = 0.02
SLOW_START_M = 0.063
# Below the least speed a healthy motor may take its time: the board's loop adds up the owed way
# until the wheel breaks loose. With the default gains that takes 15 mm, and up to twice as much if
# the wheel sticks after a jerk. A wheel without counts grows faster with every millimetre, so it is
# bounded by travel and by time.
CRAWL_NO_COUNTS = ((500_000_000, 0.045), (1_750_000_000, 0.025))
# Back and forth it may never break loose, but a wheel without counts runs at every turn, so it is
# bounded by twice the way in all.
TO_AND_FRO = 2
# A wheel that rolls and is held again gains speed until the board's loop outweighs the slope.
PULLED_M_S = 0.5
COUNTED_NS = 20_000_000
# While the line stands still in both directions, a wheel shows and obeys nothing. The time is
# limited, so that a stuttering line does not hide a dead encoder.
HELD_UP_NS = 1_000_000_000
# An encoder that rests on an edge may flicker by one count for ever.
COUNTS_OF_MOTION = 2
CREEPING_NS = 600_000_000
OFF_SPEED_NS = 1_000_000_000
OFF_SPEED_RATIO = 0.5
GAP_NS = 500_000_000


class MotorWatch:
    """Compares one motor's readings with its commands.

    Args:
        min_speed_m_s: Below this command, missing counts prove nothing.
        latency_ns: From sending a command to the first reading that can show it.
        witnessed: Returns the speed that several readings agree on, which a cut requires; ``None``
            if they are too few.

    Attributes:
        owed_m: The commanded travel since its last counts; metres of the rim.
    """

    def __init__(
        self,
        name: str,
        min_speed_m_s: float,
        latency_ns: int,
        witnessed: Callable[[], float | None] | None,
    ) -> None:
        self._name = name
        self._witnessed = witnessed
        self._min_speed_m_s = min_speed_m_s
        self._latency_ns = latency_ns
        self._commanded: float | None = None
        self._past: deque[tuple[int, float]] = deque()
        self._let_go = False
        self._started, self._slow = False, True
        self.begin(0.0)

    def begin(self, measured_m_s: float) -> None:
        """Start with an envelope from standstill to this speed and to the command."""
        commanded = self._commanded or 0.0
        self._rests = False
        self._past.clear()
        self._high = max(0.0, measured_m_s, commanded)
        self._low = min(0.0, measured_m_s, commanded)
        self._measured = measured_m_s
        self._owe_nothing()
        self._rolled = 0
        self._outside_ns: int | None = None
        self._left_ns = 0
        self._outside_m_s = 0.0
        self._creeping_ns: int | None = None
        self._slow_ns: int | None = None
        self._known: set[FaultKind] = set()

    def command(self, now_ns: int, speed_m_s: float | None) -> None:
        """Record a command that was sent to the board; ``None`` if the motor was let go."""
        if speed_m_s == self._commanded:
            return
        self._rests = False
        if not self._commanded or (speed_m_s and speed_m_s * self._commanded < 0.0):
            self._started = False
        if self._commanded is None and speed_m_s is not None:
            # The wheel coasted, so it starts from any speed up to the latest measured.
            self._commanded = speed_m_s
            self.begin(self._measured)
            if self._let_go and not speed_m_s:
                self._high += PULLED_M_S
                self._low -= PULLED_M_S
            self._past.append((now_ns, 0.0))
            return
        if self._commanded is not None:
            self._past.append((now_ns, self._commanded))
            self._forget(now_ns - GAP_NS)
            self._let_go = speed_m_s is None
        self._commanded = speed_m_s

    def measure(
        self,
        before_ns: int,
        now_ns: int,
        speed: float,
        ticks: int,
        proven: float,
        *,
        held_up: bool,
        slow_start: bool = False,
    ) -> list[Fault]:
        """Judge a reading.

        Args:
            before_ns: When the board sampled the previous reading.
            now_ns: When it sampled this one.
            speed: Measured rim speed, positive forward; m/s.
            proven: The least that the speed can be; no wheel is cut for more.
            held_up: The line was held up, so the command may not have arrived.
            slow_start: No motor of the base counts yet, or each was slow to: the loop is slow.

        Returns:
            The troubles that began with this reading.
        """
        self._measured = speed
        stands = not (speed or ticks or proven or held_up)
        if self._commanded is None or (self._rests and stands):
            return []
        # A reading also shows commands that were replaced since the previous one.
        self._forget(min(now_ns - self._latency_ns, before_ns))
        low, high = self._lately()
        fall = -math.expm1(-(now_ns - before_ns) / NS_PER_S / SLOWEST_LAG_S)
        self._high = high if high >= self._high else self._high + (high - self._high) * fall
        self._low = low if low <= self._low else self._low + (low - self._low) * fall
        steady = slowest(low, high)
        found = (
            self._runaway(now_ns, proven),
            self._creeping(before_ns, now_ns, speed),
            self._silence(now_ns - before_ns, steady, ticks, slow_start, held_up=held_up),
            self._off_speed(now_ns, speed),
        )
        faults = [fault for fault in found if fault is not None]
        # After two readings at rest, further ones of a motor that is to stand show nothing new.
        self._rests = (
            stands
            and not (faults or self._past)
            and -RESTING_M_S < self._low <= self._high < RESTING_M_S
            and self._owed_ticks == self._owed_ticks_before
        )
        return faults

    @property
    def rests(self) -> bool:
        """Whether another reading without a count shows nothing new."""
        return self._rests or self._commanded is None

    @property
    def slow_to_start(self) -> bool:
        """Whether it did not count yet since it stood or turned, or was slow to, not onward."""
        return not self._started or self._slow

    @property
    def silent(self) -> bool:
        """Whether it is accused of no counts, or about to be."""
        return "no_counts" in self._known or (not self._started and self.owed_m >= NO_COUNTS_M)

    def accused(self) -> None:
        """Its silence was reported with that of all."""
        self._known.add("no_counts")

    def _lately(self) -> tuple[float, float]:
        """The smallest and the largest command that a present reading may still show."""
        low = high = self._commanded or 0.0
        for _, speed in self._past:
            low, high = min(low, speed), max(high, speed)
        return low, high

    def _forget(self, before_ns: int) -> None:
        # An entry is the command in force until its stamp.
        while self._past and self._past[0][0] < before_ns:
            self._past.popleft()

    def _runaway(self, now_ns: int, speed: float) -> Fault | None:
        most = SPEED_FACTOR * max(self._high, 0.0) + SPEED_MARGIN_M_S
        least = SPEED_FACTOR * min(self._low, 0.0) - SPEED_MARGIN_M_S
        # If every healthy motor turns forward by now, backward needs only the margin of standing.
        if self._low >= STANDING_M_S:
            least = -STANDING_M_S
        if self._high <= -STANDING_M_S:
            most = STANDING_M_S
        if least <= speed <= most:
            self._outside_ns = None
            self._known -= {"runaway_against", "runaway_fast"}
            return None
        if self._outside_ns is None:
            self._outside_ns = self._left_ns = now_ns
            self._outside_m_s = abs(self._measured)
        if now_ns - self._outside_ns < SURE_AFTER_NS:
            return None
        slows = abs(self._measured) <= SLOWED * self._outside_m_s
        if slows and now_ns - self._left_ns < SLOWS_FOR_NS:
            self._outside_ns = now_ns
            self._outside_m_s = abs(self._measured)
            return None
        if self._known & {"runaway_against", "runaway_fast"}:
            return None
        if self._witnessed is not None:
            agreed = self._witnessed()
            if agreed is None or least <= agreed <= most:
                return None
        against = speed * (self._commanded or 0.0) < 0.0
        return self._new("runaway_against" if against else "runaway_fast", "cut", speed)

    def _creeping(self, before_ns: int, now_ns: int, speed: float) -> Fault | None:
        still = self._high < STANDING_M_S and self._low > -STANDING_M_S
        if not still or abs(speed) < STANDING_M_S:
            self._creeping_ns = None
            self._known.discard("turns_without_command")
            return None
        if abs(speed) - abs(slowest(speed, self._commanded or 0.0)) < STANDING_M_S:
            # Commanded to creep, it may do so faster: a slow motor swings about its command.
            if self._creeping_ns is not None:
                self._creeping_ns += now_ns - before_ns
            return None
        if self._creeping_ns is None:
            self._creeping_ns = now_ns
        if now_ns - self._creeping_ns < CREEPING_NS:
            return None
        return self._new("turns_without_command", "policy", speed)

    def _owe_nothing(self) -> None:
        self.owed_m = self._owed_signed_m = 0.0
        self._owed_ns = self._owed_one_way_ns = 0
        self._owed_ticks = self._owed_ticks_before = 0
        # A step that ends with counts was no silence, even if they were held back for long.
        self._held_up_ns = 0
        self._begin_silence()

    def _begin_silence(self) -> None:
        self._silent_ns = 0
        self._silent_m = 0.0

    def _silence(
        self, step_ns: int, steady: float, ticks: int, slow_start: bool, *, held_up: bool
    ) -> Fault | None:
        if held_up and self._held_up_ns < HELD_UP_NS:
            self._held_up_ns += step_ns
            step_ns = 0
        self._owed_ticks_before = self._owed_ticks
        self._owed_ticks += ticks
        self._owe(steady, step_ns)
        # Motion in either direction counts: a wheel that rolls out after a change of direction is
        # not silent, and a wheel that turns against its command is found by its speed. Two readings
        # must agree, because a garbled digit is no motion.
        if min(abs(self._owed_ticks), abs(self._owed_ticks_before)) >= COUNTS_OF_MOTION:
            before, self._rolled = self._rolled, self._owed_ticks
            if not self._started and self._rolled * steady > 0.0:
                self._started = True
                # Onward it starts at once, however stiff: the loop's output is still there.
                if before * steady <= 0.0:
                    self._slow = self.owed_m >= SLOW_M * (TURNING_ROUND if before else 1)
            self._owe_nothing()
            self._known.discard("no_counts")
            if ticks:
                step_ns = min(step_ns, COUNTED_NS)
        if abs(steady) < self._min_speed_m_s:
            self._begin_silence()
        else:
            self._silent_ns += step_ns
            self._silent_m += abs(steady) * step_ns / NS_PER_S
        slow_start_m = SLOW_START_M if slow_start and not self._started else 0.0
        times = TURNING_ROUND if self._rolled * steady < 0.0 else 1
        least_m = times * max(NO_COUNTS_M, slow_start_m)
        proven = self._silent_ns >= times * NO_COUNTS_NS and self._silent_m >= least_m
        times = TURNING_ROUND if self._rolled * self._owed_signed_m < 0.0 else 1
        crawled = False
        for least_ns, way_m in CRAWL_NO_COUNTS:
            least_m = max(way_m, slow_start_m)
            one_way = (
                self._owed_one_way_ns >= times * least_ns
                and abs(self._owed_signed_m) >= times * least_m
            )
            to_and_fro = self._owed_ns >= least_ns and self.owed_m >= TO_AND_FRO * least_m
            crawled = crawled or one_way or to_and_fro
        if not proven and not crawled:
            return None
        if abs(self._owed_ticks) >= COUNTS_OF_MOTION > abs(self._owed_ticks_before):
            # Counts that were held back arrive in one reading: the next one tells whether they are
            # motion or a garbled digit.
            return None
        return self._new("no_counts", "policy", self._measured, certain=crawled)

    def _owe(self, steady: float, step_ns: int) -> None:
        # The board's loop adds up the way with its sign, so a command back reduces the owed way.
        step_m = steady * step_ns / NS_PER_S
        before, self._owed_signed_m = self._owed_signed_m, self._owed_signed_m + step_m
        if before * self._owed_signed_m <= 0.0:
            self._owed_one_way_ns = 0
        self.owed_m += abs(step_m)
        self._owed_ns += step_ns if steady else 0
        self._owed_one_way_ns += step_ns if steady else 0

    def _off_speed(self, now_ns: int, speed: float) -> Fault | None:
        least = abs(slowest(self._low, self._high))
        if least < self._min_speed_m_s or abs(speed) >= OFF_SPEED_RATIO * least:
            self._slow_ns = None
            self._known.discard("off_speed")
            return None
        if self._slow_ns is None:
            self._slow_ns = now_ns
        if now_ns - self._slow_ns < OFF_SPEED_NS or "no_counts" in self._known:
            return None
        return self._new("off_speed", "report", speed)

    def _new(
        self, kind: FaultKind, action: Action, measured: float, *, certain: bool = False
    ) -> Fault | None:
        if kind in self._known:
            return None
        self._known.add(kind)
        commanded = self._commanded or 0.0
        text = _MESSAGES[kind].format(
            name=self._name,
            commanded=commanded,
            measured=measured,
            least=max(abs(self._owed_signed_m), self._silent_m) * 1e3,
        )
        return Fault(
            kind=kind,
            motor=self._name,
            message=text,
            action=action,
            commanded_m_s=commanded,
            measured_m_s=measured,
            certain=certain,
        )


_MESSAGES: dict[FaultKind, str] = {
    "runaway_against": (
        "{name} turns at {measured:.2f} m/s against its command of {commanded:.2f} m/s: check that "
        "the encoder's phases are not swapped, the motor's polarity, and command_sign and "
        "encoder_sign of this position."
    ),
    "runaway_fast": (
        "{name} turns at {measured:.2f} m/s where {commanded:.2f} m/s are commanded: check the "
        "encoder's plug, and that the board's motor type, lines, ratio and diameter fit the motor; "
        "or the wheel was pushed, or came free after being blocked."
    ),
    "turns_without_command": (
        "{name} turns at {measured:.2f} m/s without command: check whether the robot is pushed or "
        "stands on a slope, the encoder's plug, and that a motor sits at this position."
    ),
    "no_counts": (
        "{name} is commanded {commanded:.2f} m/s and its encoder shows no motion for {least:.0f} "
        "mm of it: check whether the wheel is blocked, then the plug of motor and encoder, the "
        "position, and the motor supply. A stiff motor may need `yahboomd tune`, for its dead zone."
    ),
    "off_speed": (
        "{name} turns at {measured:.2f} m/s where {commanded:.2f} m/s are commanded: check the "
        "load, the battery, and that the profile and command_scale fit the motor."
    ),
}
