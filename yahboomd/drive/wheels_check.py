"""Wheels that lie: command against measurement, motor by motor.

The board closes its speed loop over the same counts that we read. A dead or reversed encoder makes
that loop run away to full speed, and a zero command does not end it, so somebody has to notice.

What makes this hard is that healthy motors do not follow at once: they start after 0.02 to 0.4 s
and lag behind. So the measurement is not held against the command of the moment but against every
speed at which a healthy motor may turn by now: an envelope that follows a growing command at once
and a falling one with the slowest time constant believed (any first-order lag up to that stays
inside, as ``y' = (u - y) / tau`` falls faster than the envelope wherever they meet).

Nothing is raised; faults are values, one for each beginning of each trouble.
"""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, Literal, TypeAlias

import msgspec

from yahboomd.drive.witnesses import Witnesses
from yahboomd.model import Event

if TYPE_CHECKING:
    from collections.abc import Sequence

FaultKind: TypeAlias = Literal[
    "runaway_against",
    "runaway_fast",
    "turns_without_command",
    "no_counts",
    "off_speed",
    "stop_not_obeyed",
]
Action: TypeAlias = Literal["cut", "policy", "report"]

NS_PER_S = 1_000_000_000

SLOWEST_LAG_S = 0.4
STANDING_M_S = 0.03
SPEED_FACTOR = 1.5
SPEED_MARGIN_M_S = 0.1
# A wheel has to be cut within 150 ms of leaving its envelope. Of these the reading takes up to one
# poll period and the velocity's filter a few more milliseconds; 40 ms remain to make sure that it
# was not one garbled reading.
SURE_AFTER_NS = 40_000_000
NO_COUNTS_NS = 150_000_000
NO_COUNTS_M = 0.03
# A wheel that rolled the other way before takes twice as long to start: the output of the board's
# loop comes from the far edge of the motor's dead zone.
TURNING_ROUND = 2
# Below the least speed a healthy motor may take its time: the board's loop adds up the way that is
# owed until the wheel breaks loose. With the default gains that is after some 15 mm, and full power
# comes at 83 mm: what has not counted by then is blocked, or runs away unseen.
CRAWL_NO_COUNTS_M = 0.1
# From here on the loop's output no longer is the one of a wheel that follows.
OWED_M = 0.005
# An encoder that rests on an edge may flicker by one count for ever.
COUNTS_OF_MOTION = 2
CREEPING_NS = 600_000_000
OFF_SPEED_NS = 1_000_000_000
OFF_SPEED_RATIO = 0.5
GAP_NS = 500_000_000


class Fault(msgspec.Struct, frozen=True, kw_only=True):
    """Something wrong with a wheel.

    Attributes:
        kind: A stable word.
        motor: The motor by name; ``None`` where it concerns all of them.
        message: One sentence for a person, with what to check.
        action: ``cut``: let the motors go at once, whatever the configuration says; ``policy``: as
            ``faults.stall`` says; ``report``: tell, and go on.
        commanded_m_s: Rim speed that was commanded.
        measured_m_s: Rim speed that was measured.
    """

    kind: FaultKind
    motor: str | None
    message: str
    action: Action
    commanded_m_s: float = 0.0
    measured_m_s: float = 0.0

    def event(self) -> Event:
        """The same as an event for the bus."""
        return Event(
            kind=self.kind,
            severity="warning" if self.action == "report" else "error",
            message=self.message,
            wheel=self.motor,
            data={
                "commanded_m_s": round(self.commanded_m_s, 4),
                "measured_m_s": round(self.measured_m_s, 4),
            },
        )


class WheelsCheck:
    """Watches all motors.

    Args:
        motors: Their names.
        min_speed_m_s: Below this command, missing counts prove nothing.
        latency_s: From a command's way into the link to the first reading that can show it.
        metres_per_tick: Rim travel of one count, for each motor: with it, no single reading cuts a
            motor.
    """

    def __init__(
        self,
        motors: Sequence[str],
        *,
        min_speed_m_s: float = 0.08,
        latency_s: float = 0.06,
        metres_per_tick: Sequence[float] | None = None,
    ) -> None:
        witnesses: list[Witnesses | None] = [None] * len(motors)
        if metres_per_tick is not None:
            witnesses = [Witnesses(each) for each in metres_per_tick]
        self._watches = [
            _Watch(name, min_speed_m_s, round(latency_s * NS_PER_S), each)
            for name, each in zip(motors, witnesses, strict=True)
        ]
        self._measured_ns: int | None = None

    def command(self, now_ns: int, speeds_m_s: Sequence[float] | None) -> None:
        """Tell what the board was told.

        Args:
            now_ns: When; monotonic nanoseconds.
            speeds_m_s: Rim speed of each motor, as limited; ``None`` where the motors were let go:
                wheels without power may turn as they like.
        """
        for index, watch in enumerate(self._watches):
            watch.command(now_ns, None if speeds_m_s is None else speeds_m_s[index])

    def measure(
        self,
        stamp_ns: int,
        measured_m_s: Sequence[float],
        ticks: Sequence[int],
        *,
        proven_m_s: Sequence[float] | None = None,
        received_ns: int | None = None,
    ) -> tuple[Fault, ...]:
        """Judge a reading.

        Args:
            stamp_ns: When the board sampled it; monotonic nanoseconds. One that is not later than
                the last is no news.
            measured_m_s: Rim speed of each motor, positive forward.
            ticks: What each motor counted since the last reading, positive forward.
            proven_m_s: The least that the speeds can be (:mod:`~yahboomd.drive.proven_speed`), for
                a board whose readings may be stamped too early or too late: nobody is cut for more.
            received_ns: When it arrived, where that is known besides the stamp.

        Returns:
            The troubles that began with it.
        """
        before, self._measured_ns = self._measured_ns, stamp_ns
        if before is None or stamp_ns - before > GAP_NS:
            # Nobody knows what the wheels did meanwhile.
            for watch, speed in zip(self._watches, measured_m_s, strict=True):
                watch.begin(speed)
            return ()
        if stamp_ns <= before:
            self._measured_ns = before
            return ()
        for watch, count in zip(self._watches, ticks, strict=True):
            watch.hear(received_ns or stamp_ns, count)
        faults = [
            fault
            for watch, speed, count, proven in zip(
                self._watches, measured_m_s, ticks, proven_m_s or measured_m_s, strict=True
            )
            for fault in watch.measure(before, stamp_ns, speed, count, _nearer(speed, proven))
        ]
        silent = [fault for fault in faults if fault.kind == "no_counts"]
        if len(silent) == len(self._watches) > 1:
            faults = [fault for fault in faults if fault.kind != "no_counts"]
            faults.append(msgspec.structs.replace(silent[0], motor=None, message=_ALL_SILENT))
        return tuple(faults)

    def reset(self) -> None:
        """Forget what was seen: after a stop for a fault, after the board was away."""
        self._measured_ns = None

    @property
    def owing(self) -> bool:
        """Whether a motor shows no counts for its commands so far.

        The board's loop has added them up, and a commanded zero would leave its output where it is.
        """
        return any(watch.owed_m >= OWED_M for watch in self._watches)


def _nearer(speed: float, proven: float) -> float:
    """Of two opinions about a speed the one nearer to standing; that, where they contradict."""
    if speed * proven <= 0.0:
        return 0.0
    return speed if abs(speed) < abs(proven) else proven


class _Watch:
    """One motor."""

    def __init__(
        self, name: str, min_speed_m_s: float, latency_ns: int, witnesses: Witnesses | None
    ) -> None:
        self._name = name
        self._witnesses = witnesses
        self._min_speed_m_s = min_speed_m_s
        self._latency_ns = latency_ns
        self._commanded: float | None = None
        self._past: deque[tuple[int, float]] = deque()
        self.begin(0.0)

    def begin(self, measured_m_s: float) -> None:
        """Any speed between standing, this one and the command is plausible from here on."""
        commanded = self._commanded or 0.0
        self._past.clear()
        self._high = max(0.0, measured_m_s, commanded)
        self._low = min(0.0, measured_m_s, commanded)
        self._measured = measured_m_s
        self._begin_silence()
        self.owed_m = 0.0
        self._owed_ticks = 0
        self._rolled = 0
        self._outside_ns: int | None = None
        self._creeping_ns: int | None = None
        self._slow_ns: int | None = None
        self._known: set[FaultKind] = set()
        if self._witnesses is not None:
            self._witnesses.forget()

    def command(self, now_ns: int, speed_m_s: float | None) -> None:
        if speed_m_s == self._commanded:
            return
        if self._commanded is None and speed_m_s is not None:
            # The wheels coasted: they may start from any speed, which is the latest measured.
            self._commanded = speed_m_s
            self.begin(self._measured)
            self._past.append((now_ns, 0.0))
            return
        if self._commanded is not None:
            self._past.append((now_ns, self._commanded))
            self._forget(now_ns - GAP_NS)
        self._commanded = speed_m_s

    def hear(self, received_ns: int, ticks: int) -> None:
        if self._witnesses is not None:
            self._witnesses.hear(received_ns, ticks)

    def measure(
        self, before_ns: int, now_ns: int, speed: float, ticks: int, proven: float
    ) -> list[Fault]:
        self._measured = speed
        if self._commanded is None:
            return []
        # A reading also shows what was commanded and replaced since the one before.
        self._forget(min(now_ns - self._latency_ns, before_ns))
        low, high = self._lately()
        fall = -math.expm1(-(now_ns - before_ns) / NS_PER_S / SLOWEST_LAG_S)
        self._high = high if high >= self._high else self._high + (high - self._high) * fall
        self._low = low if low <= self._low else self._low + (low - self._low) * fall
        steady = low if low > 0.0 else min(0.0, high)
        found = (
            self._runaway(now_ns, proven),
            self._creeping(now_ns, speed),
            self._silence(now_ns - before_ns, steady, ticks),
            self._off_speed(now_ns, speed),
        )
        return [fault for fault in found if fault is not None]

    def _lately(self) -> tuple[float, float]:
        """The smallest and the largest command that a reading of now may still show."""
        low = high = self._commanded or 0.0
        for _, speed in self._past:
            low, high = min(low, speed), max(high, speed)
        return low, high

    def _forget(self, before_ns: int) -> None:
        # An entry is what was in force until its stamp.
        while self._past and self._past[0][0] < before_ns:
            self._past.popleft()

    def _runaway(self, now_ns: int, speed: float) -> Fault | None:
        most = SPEED_FACTOR * max(self._high, 0.0) + SPEED_MARGIN_M_S
        least = SPEED_FACTOR * min(self._low, 0.0) - SPEED_MARGIN_M_S
        # Where every healthy motor turns forward by now, backward needs no margin beyond standing.
        if self._low >= STANDING_M_S:
            least = -STANDING_M_S
        if self._high <= -STANDING_M_S:
            most = STANDING_M_S
        if least <= speed <= most:
            self._outside_ns = None
            self._known -= {"runaway_against", "runaway_fast"}
            return None
        if self._outside_ns is None:
            self._outside_ns = now_ns
        if now_ns - self._outside_ns < SURE_AFTER_NS:
            return None
        if self._known & {"runaway_against", "runaway_fast"}:
            return None
        if self._witnesses is not None:
            agreed = self._witnesses.speed_m_s()
            if agreed is None or least <= agreed <= most:
                return None
        against = speed * (self._commanded or 0.0) < 0.0
        return self._new("runaway_against" if against else "runaway_fast", "cut", speed)

    def _creeping(self, now_ns: int, speed: float) -> Fault | None:
        still = self._high < STANDING_M_S and self._low > -STANDING_M_S
        if not still or abs(speed) < STANDING_M_S:
            self._creeping_ns = None
            self._known.discard("turns_without_command")
            return None
        if self._creeping_ns is None:
            self._creeping_ns = now_ns
        if now_ns - self._creeping_ns < CREEPING_NS:
            return None
        return self._new("turns_without_command", "policy", speed)

    def _begin_silence(self) -> None:
        self._silent_ns = 0
        self._silent_m = 0.0
        self._counted = 0

    def _silence(self, step_ns: int, steady: float, ticks: int) -> Fault | None:
        step_m = abs(steady) * step_ns / NS_PER_S
        self._counted += ticks
        self._owed_ticks += ticks
        self.owed_m += step_m
        # Motion either way is motion: a wheel that still rolls out after a change of direction is
        # not silent, and one that turns against its command is found by its speed.
        if abs(self._owed_ticks) >= COUNTS_OF_MOTION:
            self._rolled = self._owed_ticks
            self.owed_m = 0.0
            self._owed_ticks = 0
            self._known.discard("no_counts")
        if abs(steady) < self._min_speed_m_s or abs(self._counted) >= COUNTS_OF_MOTION:
            self._begin_silence()
        else:
            self._silent_ns += step_ns
            self._silent_m += step_m
        times = TURNING_ROUND if self._rolled * steady < 0.0 else 1
        proven = self._silent_ns >= times * NO_COUNTS_NS and self._silent_m >= times * NO_COUNTS_M
        if not proven and self.owed_m < CRAWL_NO_COUNTS_M:
            return None
        return self._new("no_counts", "policy", self._measured)

    def _off_speed(self, now_ns: int, speed: float) -> Fault | None:
        slowest = max(self._low, -self._high)
        if slowest < self._min_speed_m_s or abs(speed) >= OFF_SPEED_RATIO * slowest:
            self._slow_ns = None
            self._known.discard("off_speed")
            return None
        if self._slow_ns is None:
            self._slow_ns = now_ns
        if now_ns - self._slow_ns < OFF_SPEED_NS or "no_counts" in self._known:
            return None
        return self._new("off_speed", "report", speed)

    def _new(self, kind: FaultKind, action: Action, measured: float) -> Fault | None:
        if kind in self._known:
            return None
        self._known.add(kind)
        commanded = self._commanded or 0.0
        text = _MESSAGES[kind].format(
            name=self._name,
            commanded=commanded,
            measured=measured,
            least=max(self.owed_m, self._silent_m) * 1e3,
        )
        return Fault(
            kind=kind,
            motor=self._name,
            message=text,
            action=action,
            commanded_m_s=commanded,
            measured_m_s=measured,
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
        "position, and the motor supply."
    ),
    "off_speed": (
        "{name} turns at {measured:.2f} m/s where {commanded:.2f} m/s are commanded: check the "
        "load, the battery, and that the profile and command_scale fit the motor."
    ),
}

_ALL_SILENT = (
    "All motors are commanded to turn and no encoder shows motion: check the motor supply and its "
    "switch, then that the motors sit at the configured positions."
)
