"""Finds in the commands of one source why its robot stutters, shakes or stands: their rhythm.

Commands that come too seldom or too often, and two programs that use one key. The transport names
no sender, so two programs are recognised by their values: one jumps and comes back before a ramp
could follow. Without names, 0.30 and 0 in turn at 1 Hz may as well be a tapped key. Programs that
name themselves in their commands are two at any rate, and one name is one. Nothing is refused here.
"""

from __future__ import annotations

import msgspec

from yahboomd.core.drive.arbitration import AllowedSource
from yahboomd.core.drive.windows import SlidingCounts
from yahboomd.core.model import NS_PER_S, Cause, Twist2d
from yahboomd.core.names import source_words

BACK_WITHIN_NS = 250_000_000
"""A value that returns within this time, after a single command of the other one, was another
program's all the while: fingers are slower."""
COPY_NS = 5_000_000
"""Copies of a command come within this time."""
JUMP_M_S = 0.05
"""Commands of one program that drives differ by less from one to the next, as a rule."""
ARM_M = 0.2
"""A turn counts as the speed at this distance from the centre."""
RETURNS, WITHIN_NS = 8, 3 * NS_PER_S
"""This number of returns within this time are two programs; half as many if both are named."""
PAUSE_S = 1.5
"""After a longer silence the next command is a new one."""
TOLD_NS = 5 * NS_PER_S
"""A gap is reported for this time."""
MOST_HZ = 250
"""More commands than this look like a backlog (:mod:`~yahboomd.core.drive.backlog`)."""


class _Given(msgspec.Struct, frozen=True):
    at_ns: int
    twist: Twist2d
    sender: str


class Rhythm:
    """The rhythm of one source's commands."""

    def __init__(self, source: AllowedSource) -> None:
        self._source = source
        self._latest = self._other = _Given(-WITHIN_NS, Twist2d(), "")
        self._alike = 0
        self._returns = SlidingCounts(WITHIN_NS)
        self._rate = SlidingCounts(NS_PER_S)
        self._gap_s, self._gap_ns = 0.0, -TOLD_NS

    def note(self, now_ns: int, twist: Twist2d, sender: str, arrivals: int) -> None:
        """Add a command that arrived, obeyed or not, and those lost before it."""
        before, self._latest = self._latest, _Given(now_ns, twist, sender)
        self._rate.add(now_ns, "", arrivals)
        gap_s = (now_ns - before.at_ns) / NS_PER_S
        if self._source.timeout_s < gap_s < PAUSE_S and not (twist.is_zero or before.twist.is_zero):
            self._gap_s, self._gap_ns = gap_s, now_ns
        jump_m_s = _apart(twist, before.twist)
        if jump_m_s >= JUMP_M_S:
            back = _apart(twist, self._other.twist) < jump_m_s / 2.0
            named = bool(sender and before.sender)
            quick = self._alike == 1 and now_ns - self._other.at_ns <= BACK_WITHIN_NS
            if back and (sender != before.sender if named else quick):
                self._returns.add(now_ns, "", 1 + named)
            self._other, self._alike = before, 1
        elif now_ns - before.at_ns > COPY_NS:
            self._alike += 1

    def causes(self, now_ns: int, near: str, *, refusing: bool) -> list[Cause]:
        """What is wrong with it, and what to do.

        Args:
            near: Where programs may be that do not name themselves.
            refusing: Its commands are refused as a backlog.
        """
        name, lasts_s = source_words(self._source.name), self._source.timeout_s
        found = list[Cause]()
        if sum(self._returns.counts(now_ns).values()) >= RETURNS:
            pair = sorted((self._latest, self._other), key=lambda given: given.twist.is_zero)
            values = " and ".join(map(_value, pair))
            nameless = "" if self._latest.sender or self._other.sender else near
            words = f"Two programs command {name}: {values}{nameless}. End one of them, or give it "
            words += "another source."
            found.append(Cause("two_programs", words))
        rate_hz = sum(self._rate.counts(now_ns).values())
        if refusing and rate_hz > MOST_HZ:
            words = f"{name} is commanded {rate_hz} times a second, and more than {MOST_HZ} look"
            words += " like a backlog, which is refused. Send 10 to 50 a second."
            found.append(Cause("too_often", words))
        if now_ns - self._gap_ns < TOLD_NS:
            words = (
                f"{name} was commanded {self._gap_s:.2f} s ({1.0 / self._gap_s:.1f} Hz) after its "
                f"command before, which lasts {lasts_s:g} s: the robot stops between. Send "
                f"{5.0 / lasts_s:.0f} a second; for a key that repeats so late set "
                f'command.sources."{self._source.name}".timeout_s = {self._gap_s + 0.1:.1f}.'
            )
            found.append(Cause("too_seldom", words))
        return found


def _apart(one: Twist2d, other: Twist2d) -> float:
    return max(abs(one.vx - other.vx), abs(one.vy - other.vy), ARM_M * abs(one.wz - other.wz))


def _value(given: _Given) -> str:
    twist = given.twist
    named = ((twist.vx, "m/s"), (twist.vy, "m/s to the left"), (twist.wz, "rad/s"))
    parts = [f"{value:.2f} {unit}" for value, unit in named if value]
    by = f" ({given.sender})" if given.sender else ""
    return (" and ".join(parts) or "0") + by
