"""Raw counters to signed travel of each motor.

Law: counts become travel only when they can be travel. A reading that cannot (the board was reset,
the port was away, a digit was lost) is held until later readings agree with it, and decided only
then; the totals never jump. Holding loses nothing: the next reading contains the same counts.

The limit is a step of ``speed_max · time + one tick`` on any motor.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

import msgspec

from yahboomd.core.counts import HALF, unwrapped
from yahboomd.core.model import Counts, Motor

AGREE_SLACK_NS = 20_000_000
"""The most that two readings may lie apart beyond their arrivals: the worst USB latency."""

AGREE_ANNOUNCED = 2
AGREE_RESET = 3
AGREE_ELSEWHERE = 5
"""The readings in a row that must agree: after a notice, for an unannounced reset, and for counters
that jumped for no known reason (a lossy line drops the same digit twice in a row more often than
expected)."""

STRAY_M = 0.002
STRAY_M_S = 0.25
STRAY_NS = 8_000_000
STRAY_MOST_M = 0.025
"""A step that ends this far from the wheel's expected place waits for others to agree. The limit
grows with the time that the wheel had to change its speed, and with its pace, because the sampling
time is not known to the millisecond. A wheel that is blocked or released strays as well, and is
believed one reading later, which contradicts a garbled digit."""

AGREE_STRAYED = 3
"""This many readings in a row, each in reach of the one before, are believed at any spacing."""

ELSEWHERE_NS = 200_000_000
"""The time that those readings must span. If a garbled line was taken for travel, later lines take
it back after the time that the way back needs; a burst must not decide before."""

ORIGIN: Counts = (0, 0, 0, 0)
"""The counters of a board that was just reset."""

UNMISTAKABLE_TICKS = 64
"""Counters that return unchanged to the tick, at least this far from zero, were not reset."""

EXPECTED_M = 0.025
EXPECTED_SHARE = 0.1
"""Without a command the wheels keep their speed: the counters match it within these bounds."""

ROLLED_S = 0.5
"""A reset board releases its wheels: they coast at most as far as they went in this time before."""

Outcome: TypeAlias = Literal[
    "baseline",  # the first reading of all: counting starts here
    "travel",  # an ordinary step
    "held",  # cannot be travel, or was announced as special: wait for the next reading
    "reset",  # the board reported a reset: counted from zero
    "reset_unseen",  # the counters fell to near zero unannounced: counted from zero
    "gap_kept",  # the port was away, and the board kept counting
    "gap_lost",  # the port was away, and it may have been reset: nothing is counted
    "rebased",  # the counters jumped for no known reason: nothing is counted
]

Notice: TypeAlias = Literal["none", "silence", "restart", "away", "reset"]
"""What came between two readings: nothing, no line, no daemon, no port, or a reset that the board
reported."""


class Verdict(msgspec.Struct, frozen=True, kw_only=True):
    """The meaning of one reading.

    Attributes:
        ticks: The raw counters of the reading.
        deltas: Signed counts per motor that are travel since the last accepted reading.
        farthest: The largest magnitude of them; only for an ordinary step.
        least_ns: The least time that they take; only for an ordinary step.
        strayed: Whether an ordinary step was believed although no wheel was heading there.
    """

    outcome: Outcome
    ticks: Counts
    deltas: tuple[int, ...]
    farthest: int = 0
    least_ns: float = 0.0
    strayed: bool = False


class Encoders:
    """The counters of the board, as signed totals of each motor that never wrap.

    :meth:`judge` classifies a reading and :meth:`accept` counts it, so that a caller can skip a
    reading that shows nothing new.

    Args:
        motors: The motors on the board, in the order of every tuple here.
        speed_max_m_s: A rim speed that no wheel of this robot reaches.
    """

    __slots__ = (
        "_channels _ns_per_tick _ticks_per_m _zero _still _paces _pace _turned _last _suspect "
        "_unbroken _went notice totals"
    ).split()

    def __init__(self, motors: tuple[Motor, ...], *, speed_max_m_s: float) -> None:
        self._channels = tuple((motor.position - 1, motor.encoder_sign) for motor in motors)
        self._ns_per_tick = tuple(motor.metres_per_tick / speed_max_m_s * 1e9 for motor in motors)
        self._ticks_per_m = tuple(1.0 / motor.metres_per_tick for motor in motors)
        self._zero = (0,) * len(motors)
        self._still = (0.0,) * len(motors)
        # Counts per nanosecond of the last three steps, and their median; unknown after a break.
        self._paces: tuple[tuple[float, ...], ...] = ()
        self._pace = self._still
        self._turned = False
        self._last: Counts | None = None
        self._suspect: tuple[Counts, int, int] | None = None
        self.notice: Notice = "none"
        self._unbroken = False
        self._went = self._still  # counts per nanosecond before a gap
        self.totals: tuple[int, ...] = self._zero

    def announce(
        self, notice: Notice, *, unbroken: bool = False, speeds_m_s: tuple[float, ...] | None = None
    ) -> None:
        """Remember a notice until two readings settle it; of several, the worst.

        Args:
            unbroken: The board was certainly not reset in that gap.
            speeds_m_s: Speeds of the wheels before it.
        """
        if self._last is not None and self.notice != "reset":
            if (self.notice, notice) != ("away", "silence"):
                self.notice = notice
            self._unbroken = unbroken
            self._suspect = None
            pairs = zip(speeds_m_s or self._still, self._ticks_per_m, strict=True)
            self._went = tuple([speed * 1e-9 * per_m for speed, per_m in pairs])

    def least_ns(self, deltas: tuple[int, ...]) -> float:
        """The least time in which the wheels can travel this far, one tick of grace included."""
        least = 0.0
        for delta, ns_per_tick in zip(deltas, self._ns_per_tick, strict=True):
            need = (abs(delta) - 1) * ns_per_tick
            if need > least:  # noqa: PLR1730 - max() costs four times as much, 400 times a second
                least = need
        return least

    def since(self, then: Counts, now: Counts) -> tuple[int, ...]:
        """Signed counts per motor from one reading to another, modulo 2^32, the short way round."""
        deltas = []
        for channel, sign in self._channels:
            delta = unwrapped(now[channel] - then[channel])
            deltas.append(delta if sign > 0 else -delta)
        return tuple(deltas)

    def repeats(self, ticks: Counts) -> bool:
        """Whether a reading equals the last accepted one; then nothing is left to judge."""
        if ticks != self._last or self.notice != "none":
            return False
        self._suspect = None
        return True

    def unmoved(self) -> Verdict:
        assert self._last is not None
        return Verdict(outcome="travel", ticks=self._last, deltas=self._zero)

    def judge(
        self, ticks: Counts, sent_ns: int, elapsed_ns: float, *, fresh: bool = True
    ) -> Verdict:
        """Classify a reading; nothing is counted yet.

        Args:
            sent_ns: When the line left the board, as far as known.
            elapsed_ns: The longest time that may have passed on the board since the last accepted
                reading.
            fresh: The line just left the board, and did not wait in a backlog.

        Returns:
            The verdict; pass it to :meth:`accept` unless it is ``held``.
        """
        last = self._last
        if last is None:
            return Verdict(outcome="baseline", ticks=ticks, deltas=self._zero)
        if self.notice == "none":
            if ticks == last:
                self._suspect = None
                return Verdict(outcome="travel", ticks=last, deltas=self._zero)
            deltas = self.since(last, ticks)
            least_ns = self.least_ns(deltas)
            if least_ns <= elapsed_ns and not self._strays(deltas, ticks, sent_ns, elapsed_ns):
                self._suspect = None
                strayed, self._turned = self._turned, False
                if elapsed_ns > 0:
                    self._go_on(tuple([delta / elapsed_ns for delta in deltas]))
                return Verdict(
                    outcome="travel",
                    ticks=ticks,
                    deltas=deltas,
                    farthest=max(*deltas, -min(deltas)),
                    least_ns=least_ns,
                    strayed=strayed,
                )
        agreed = 1 + self._agreed(ticks, sent_ns)
        sure = self._witnessed(self.since(last, ticks), ticks, sent_ns, elapsed_ns)
        self._suspect = (ticks, sent_ns, agreed)
        return self._settle(last, ticks, elapsed_ns, agreed, sure=sure, fresh=fresh)

    def accept(self, verdict: Verdict) -> None:
        self._last = verdict.ticks
        if verdict.outcome != "travel":
            self._suspect = None
            self.notice = "none"
            self._paces = ()
            self._pace = self._still
        elif verdict.deltas is self._zero:
            self._go_on(self._still)
        if verdict.deltas is not self._zero:
            self.totals = tuple(
                [total + delta for total, delta in zip(self.totals, verdict.deltas, strict=True)]
            )

    def _go_on(self, pace: tuple[float, ...]) -> None:
        """Keep the median pace: a garbled reading makes one too fast and the next too slow."""
        self._paces = paces = (*self._paces[-2:], pace)
        if len(paces) < 3:
            self._pace = pace
            return
        self._pace = tuple(
            [a + b + c - max(a, b, c) - min(a, b, c) for a, b, c in zip(*paces, strict=True)]
        )

    def _strays(
        self, deltas: tuple[int, ...], ticks: Counts, sent_ns: int, elapsed_ns: float
    ) -> bool:
        """Whether a step is unlikely and no other reading confirms it."""
        stray_m = STRAY_MOST_M
        if self._paces:
            stray_m = min(stray_m, STRAY_M + STRAY_M_S * 1e-9 * elapsed_ns)
        for delta, pace, ticks_per_m in zip(deltas, self._pace, self._ticks_per_m, strict=True):
            if abs(delta - pace * elapsed_ns) > stray_m * ticks_per_m + abs(pace) * STRAY_NS:
                if self._fell(deltas, ticks) or not self._witnessed(
                    deltas, ticks, sent_ns, elapsed_ns
                ):
                    return True
                # The wheel did change its speed.
                self._paces = ()
                self._turned = True
                return False
        return False

    def _witnessed(
        self, deltas: tuple[int, ...], ticks: Counts, sent_ns: int, elapsed_ns: float
    ) -> bool:
        """Whether the reading before shows the same motion as this one.

        Between the two, a wheel's pace lies between its old pace and, under constant acceleration,
        twice its mean pace since then less the old one. A garbled digit in either breaks this.
        """
        agreed = self._agreed(ticks, sent_ns)
        if not agreed or self._suspect is None or elapsed_ns <= 0:
            return False
        if agreed + 1 >= AGREE_STRAYED:
            return True
        then, then_ns, _ = self._suspect
        apart_ns = min(max(0, sent_ns - then_ns), elapsed_ns)
        stray_m = min(STRAY_MOST_M, STRAY_M + STRAY_M_S * 1e-9 * apart_ns)
        for step, delta, pace, ticks_per_m in zip(
            self.since(then, ticks), deltas, self._pace, self._ticks_per_m, strict=True
        ):
            beyond = 2.0 * delta / elapsed_ns - pace
            low, high = min(pace, beyond), max(pace, beyond)
            slack = stray_m * ticks_per_m + max(-low, high) * STRAY_NS
            if not low * apart_ns - slack <= step <= high * apart_ns + slack:
                return False
        return True

    def _fell(self, deltas: tuple[int, ...], ticks: Counts) -> bool:
        """Whether counting from zero explains a step better than travel does.

        A reset returns all counters; a lost digit changes one.
        """
        from_zero = self.since(ORIGIN, ticks)
        if 2 * max(map(abs, from_zero)) >= max(map(abs, deltas)):
            return False
        before = [abs(now - delta) for now, delta in zip(from_zero, deltas, strict=True)]
        far = max(before) / 8
        return all(
            2 * abs(now) <= was for now, was in zip(from_zero, before, strict=True) if was > far
        )

    def _agreed(self, ticks: Counts, sent_ns: int) -> int:
        """The number of consecutive readings just before that agree with this one."""
        if self._suspect is None:
            return 0
        then, then_ns, agreed = self._suspect
        least_ns = self.least_ns(self.since(then, ticks))
        return agreed if least_ns <= sent_ns - then_ns + AGREE_SLACK_NS else 0

    def _expected(
        self, travel: tuple[int, ...], from_zero: tuple[int, ...], elapsed_ns: float
    ) -> bool:
        """Whether wheels that kept their speed, or stopped, explain the counters, not a reset."""
        kept, beyond = True, False
        # A daemon that ends stops the wheels; its guard does so if it is killed.
        stopped = self.notice == "restart"
        for delta, now, went, per_m in zip(
            travel, from_zero, self._went, self._ticks_per_m, strict=True
        ):
            expected = went * elapsed_ns
            rolled = EXPECTED_M * per_m + abs(went) * ROLLED_S * 1e9
            near = EXPECTED_M * per_m + EXPECTED_SHARE * abs(expected)
            kept = kept and abs(delta - expected) <= near
            stopped = stopped and abs(delta) <= rolled
            beyond = beyond or (went != 0.0 and abs(now) > rolled)
        return beyond and (kept or stopped)

    def _settle(
        self,
        last: Counts,
        ticks: Counts,
        elapsed_ns: float,
        agreed: int,
        *,
        sure: bool,
        fresh: bool,
    ) -> Verdict:
        held = Verdict(outcome="held", ticks=ticks, deltas=self._zero)
        if agreed < AGREE_ANNOUNCED:
            return held
        travel = self.since(last, ticks)
        from_zero = self.since(ORIGIN, ticks)
        near_zero = self.least_ns(from_zero) <= elapsed_ns
        # These counts share their one tick of grace with the next step.
        room_ns = elapsed_ns - max(self._ns_per_tick)
        if self.notice in {"silence", "restart", "away"}:
            if not sure:
                return held
            far = max(map(abs, from_zero)) >= UNMISTAKABLE_TICKS
            # The port stayed, and wheels that stood lose no travel by a reset.
            rested = self.notice != "away" and not any(self._went)
            untouched = not any(travel) and (far or rested)
            # Beyond half the range the counters may have wrapped more than once.
            fits = self.least_ns(travel) <= room_ns < HALF * min(self._ns_per_tick)
            if untouched or (fits and (self._unbroken or not near_zero)):
                return Verdict(outcome="gap_kept", ticks=ticks, deltas=travel)
            if not fresh:
                # The line may be as old as the gap: the expected travel is not known yet.
                return held
            if fits and self._expected(travel, from_zero, elapsed_ns):
                return Verdict(outcome="gap_kept", ticks=ticks, deltas=travel)
            return Verdict(outcome="gap_lost", ticks=ticks, deltas=self._zero)
        announced = self.notice == "reset"
        if self.least_ns(from_zero) <= room_ns and (announced or self._fell(travel, ticks)):
            outcome: Outcome = "reset" if announced else "reset_unseen"
            if not announced and agreed < AGREE_RESET:
                return held
            return Verdict(outcome=outcome, ticks=ticks, deltas=from_zero)
        if agreed < AGREE_ELSEWHERE or elapsed_ns < ELSEWHERE_NS:
            return held
        return Verdict(outcome="rebased", ticks=ticks, deltas=self._zero)
