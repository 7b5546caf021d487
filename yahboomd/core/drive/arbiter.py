"""Decides who drives: one source at a time, by priority, while its commands are fresh.

- The larger priority takes control at once. Among equals the source in control keeps it, and a zero
  command holds it too.
- Otherwise control changes hands only from standstill: the holder's last command ran out, the
  wheels were commanded to zero and measured standing, and a command given after that arrives.
- A command is valid for its source's timeout, counted from when it was given. An older command, one
  out of order, or one of a backlog is refused (:mod:`~yahboomd.core.drive.age`,
  :mod:`~yahboomd.core.drive.backlog`).

The arbiter remembers every command for motion for a second, even a refused one. An emergency stop
must not be released while a source commands motion, and after a command that was refused as stale,
as a copy or for its priority an accepted one may follow.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import msgspec

from yahboomd.core.drive.age import Age, StampPolicy
from yahboomd.core.drive.arbitration import (
    AllowedSource,
    CommandRefused,
    Decision,
    Reason,
    Why,
)
from yahboomd.core.drive.command_source import CommandSource
from yahboomd.core.drive.deadman import OnTimeout
from yahboomd.core.drive.windows import SlidingCounts
from yahboomd.core.model import STANDSTILL, Cause, Twist2d, velocity_problem
from yahboomd.core.standstill import turning

if TYPE_CHECKING:
    from collections.abc import Sequence

RECENT_NS = 2_000_000_000
"""The span of :meth:`Arbiter.recent_refusals`."""


class _Handover(msgspec.Struct, frozen=True, kw_only=True):
    at_ns: int
    previous: str | None
    previous_since_ns: int | None
    previous_last: str | None


class Arbiter:
    """Decides which source drives.

    Args:
        on_timeout: Whether silence ends in a ramp or a halt.
        stamps: How the age of a command is judged.

    Attributes:
        counters: Commands that were ``accepted``, that ``took_over`` and that were refused for each
            reason, backlogs that were ``revoked``, and drivers that ``timed_out``.
    """

    def __init__(
        self,
        sources: Sequence[AllowedSource],
        *,
        on_timeout: OnTimeout = "ramp",
        stamps: StampPolicy = "relative",
    ) -> None:
        self.counters: Counter[str] = Counter()
        self._recent = SlidingCounts(RECENT_NS)
        self._on_timeout = on_timeout
        self._lines = {source.name: CommandSource(source, stamps) for source in sources}
        self._holder: CommandSource | None = None
        self._since_ns: int | None = None
        self._last: CommandSource | None = None
        self._free_ns: int | None = None
        self._handover: _Handover | None = None
        self._revoked = False
        self._left: tuple[str, int] | None = None
        self._timeout_counted = False
        self._waited_since_ns = self._waited_ns = 0

    def offer(
        self,
        source: str,
        twist: Twist2d,
        now_ns: int,
        stamp_ns: int | None = None,
        stamp_is_message: bool = False,
        *,
        wall_ns: int | None = None,
        arrivals: int = 1,
        sender: str = "",
    ) -> CommandRefused | None:
        """Accept or refuse a command.

        If several commands arrived in one piece, offer them one after the other before the next
        control step, or offer only the newest with their number. So a backlog is found before it
        has any effect.

        Args:
            stamp_ns: When it was given, on the giver's clock, if it is known.
            stamp_is_message: The stamp is the sender's own, not the transport's.
            wall_ns: When it arrived on the clock of the stamps, for ``absolute`` and for
                :meth:`clock_offsets_s`.
            arrivals: The number of commands from this source since the last one offered.
            sender: The program that gave it, as it names itself.

        Returns:
            The refusal; None if it is in effect. No command raises.
        """
        line = self._lines.get(source)
        if line is None:
            why = "No configured source has that name."
            return self._refuse(now_ns, "unknown_source", why)
        if (problem := velocity_problem(twist.vx, twist.vy, twist.wz)) is not None:
            return self._refuse(now_ns, *problem)
        if not twist.is_zero:
            line.note_motion(now_ns)
        line.rhythm.note(now_ns, twist, sender, arrivals)
        age = line.admit(
            twist,
            now_ns,
            stamp_ns,
            by_sender=stamp_is_message,
            wall_ns=wall_ns,
            arrivals=arrivals,
        )
        if not isinstance(age, Age):
            if age == "revoke" or age == "refuse":  # noqa: PLR1714 - the types follow from it
                if age == "revoke":
                    self._revoke(line, now_ns)
                return self._refuse(now_ns, "backlog", _HELD_UP)
            return self._refuse(now_ns, age, _AGE_DETAILS[age])
        if not (twist.is_zero or age.proven) and self._waited_since_ns < now_ns <= self._waited_ns:
            detail = "It may have waited while yahboomd did not run, and no stamp shows its age."
            return self._refuse(now_ns, "after_pause", detail)
        given_ns = now_ns - age.age_ns
        refusal = self._may_drive(line, now_ns, given_ns)
        line.feed(twist, given_ns)
        if refusal is not None:
            return refusal
        if self._holder is not line:
            self._hand_over(line, now_ns)
        self._last = line
        self._revoked = False
        self._left = None
        self._timeout_counted = False
        self.counters["accepted"] += 1
        return None

    def observe_wheels(
        self, now_ns: int, *, commanded_zero: bool, measured_m_s: Sequence[float] | None
    ) -> None:
        """Observe the wheels: control passes down only from standstill.

        Args:
            commanded_zero: The latest frame to the board commands standstill.
            measured_m_s: Rim speeds of a reading later than that frame; ``None`` if unknown.
        """
        holder = self._holder
        if holder is None or not holder.deadman.expired(now_ns) or not commanded_zero:
            return
        if measured_m_s is None or turning(measured_m_s):
            return
        self._count_timeout()
        self._holder = None
        self._since_ns = now_ns
        self._free_ns = now_ns

    def current(self, now_ns: int) -> Decision:
        """The motion that the wheels should make at ``now_ns``.

        It never contains motion by a command that ran out or was revoked.
        """
        holder, last = self._holder, self._last
        age_ns = None if last is None else last.deadman.age_ns(now_ns)
        name = None if last is None else last.source.name
        silent = age_ns is None
        if self._left is not None:
            name, age_ns = self._left[0], now_ns - self._left[1]
        twist, ramp = STANDSTILL, True
        why: Why
        if self._revoked:
            why, ramp = "revoked", False
        elif silent:
            why = "no_command"
        elif holder is None or (wish := holder.in_effect(now_ns)) is None:
            self._count_timeout()
            ramp = self._on_timeout == "ramp"
            why = "ended" if self._ended else "timed_out"
        elif wish.is_zero:
            why = "zero_command"
        else:
            why, twist = "driving", wish
        return Decision(
            twist=twist,
            driver=None if holder is None else holder.source.name,
            since_ns=self._since_ns,
            ramp=ramp,
            why=why,
            source=name,
            age_ns=age_ns,
        )

    @property
    def deadline_ns(self) -> int | None:
        """The end of the command in effect, when a control step is due; ``None`` without one."""
        return None if self._holder is None else self._holder.deadman.deadline_ns

    def moving_sources(self, now_ns: int) -> tuple[str, ...]:
        """The sources that command motion, or did within the last second, obeyed or refused."""
        return tuple(name for name, line in self._lines.items() if line.commands_motion(now_ns))

    def note_motion(self, source: str, now_ns: int) -> None:
        """Record that a source commands motion, by this command or by one that was lost unread."""
        line = self._lines.get(source)
        if line is not None:
            line.note_motion(now_ns)

    def note_refusal(self, now_ns: int, reason: str) -> None:
        """Count a command that was refused elsewhere, to explain a robot that stands."""
        self._recent.add(now_ns, reason)

    def recent_refusals(self, now_ns: int) -> dict[str, int]:
        """The commands that were refused in the last two seconds, counted by reason."""
        return self._recent.counts(now_ns)

    def causes(self, now_ns: int, near: str = "") -> list[Cause]:
        """Why commands make the robot stutter, shake or stand, though they are obeyed."""
        lines = self._lines.values()
        return [
            each
            for line in lines
            for each in line.rhythm.causes(now_ns, near, refusing=line.gate.refusing)
        ]

    def clock_offsets_s(self, now_ns: int) -> dict[str, float]:
        """The clock of each source that stamped commands lately, less this clock; seconds."""
        found = {name: line.offset.ahead_s(now_ns) for name, line in self._lines.items()}
        return {name: ahead_s for name, ahead_s in found.items() if ahead_s is not None}

    def clock_warnings(self, now_ns: int) -> dict[str, str]:
        """Describe the offset and its effect for each source whose clock disagrees."""
        found = {name: line.offset.warning(now_ns) for name, line in self._lines.items()}
        return {name: words for name, words in found.items() if words is not None}

    def forget_commands(self, now_ns: int, *, clients_left: bool = False) -> None:
        """Discard every command and the source in control, as if there had been no command yet.

        Used when the bus is lost or the board was away, because earlier commands are over then. The
        sources' recent motion stays remembered.

        Args:
            now_ns: Monotonic nanoseconds.
            clients_left: No client is connected any more; name the one that drove.
        """
        wish = None if self._holder is None else self._holder.in_effect(now_ns)
        drove = clients_left and wish is not None and not wish.is_zero
        self._left = (self._holder.source.name, now_ns) if self._holder and drove else None
        for line in self._lines.values():
            line.drop()
        self._holder = self._last = self._handover = None
        self._revoked = False
        self._since_ns = self._free_ns = now_ns

    def paused(
        self, since_ns: int, until_ns: int, *, waited_ns: int, clock_stood: bool = False
    ) -> None:
        """Note that this process did not run, so that commands which waited arrive as if new.

        Commands for motion are refused unless the sender's stamp proves their age.

        Args:
            since_ns: The latest moment when it ran; monotonic nanoseconds.
            until_ns: When it ran again.
            waited_ns: For this time afterwards, arriving commands may have waited.
            clock_stood: Monotonic time stood still meanwhile, so every earlier command is over, and
                the differences from the senders' clocks are void.
        """
        self._waited_since_ns, self._waited_ns = since_ns, until_ns + waited_ns
        for line in self._lines.values():
            if line.commands_motion(since_ns):
                # It may still command motion, unseen.
                line.note_motion(until_ns)
            if clock_stood:
                line.judge.reset()
        if clock_stood:
            self.forget_commands(until_ns)

    def _may_drive(self, line: CommandSource, now_ns: int, given_ns: int) -> CommandRefused | None:
        holder = self._holder
        if holder is line:
            return None
        if holder is None:
            if self._free_ns is not None and given_ns < self._free_ns:
                detail = "It was given before the wheels stood."
                return self._refuse(now_ns, "not_standing", detail)
            return None
        if line.source.priority > holder.source.priority:
            return None
        if holder.deadman.expired(now_ns):
            detail = f"{holder.source.name} fell silent, and the wheels do not stand yet."
            return self._refuse(now_ns, "not_standing", detail)
        detail = f"{holder.source.name} drives, with priority {holder.source.priority}."
        return self._refuse(now_ns, "lower_priority", detail)

    def _hand_over(self, line: CommandSource, now_ns: int) -> None:
        self._handover = _Handover(
            at_ns=now_ns,
            previous=None if self._holder is None else self._holder.source.name,
            previous_since_ns=self._since_ns,
            previous_last=None if self._last is None else self._last.source.name,
        )
        self._holder = line
        self._since_ns = now_ns
        self.counters["took_over"] += 1

    def _revoke(self, line: CommandSource, now_ns: int) -> None:
        """Revoke the commands of ``line`` since its silence."""
        had_a_command = line.in_effect(now_ns) is not None
        line.drop()
        if self._holder is not line or not had_a_command:
            return
        self.counters["revoked"] += 1
        before = self._handover
        if before is not None and before.at_ns >= line.gate.watching_since_ns:
            # It took control with the backlog, so give control back to the source before, with its
            # newest command, which may have been refused meanwhile.
            self._holder = self._lines[before.previous] if before.previous else None
            self._since_ns = before.previous_since_ns
            self._last = self._lines[before.previous_last] if before.previous_last else None
        self._handover = None
        holder = self._holder
        self._revoked = holder is None or holder.in_effect(now_ns) is None

    @property
    def _ended(self) -> bool:
        """Whether the last command was a zero, which ends a source in order."""
        last = self._last
        return last is not None and last.wish is not None and last.wish.is_zero

    def _count_timeout(self) -> None:
        if not self._timeout_counted:
            self._timeout_counted = True
            self.counters["timed_out"] += not self._ended

    def _refuse(self, now_ns: int, reason: Reason, detail: str) -> CommandRefused:
        self.counters[reason] += 1
        self._recent.add(now_ns, reason)
        return CommandRefused(reason=reason, detail=detail)


_HELD_UP = "It came in a burst after a silence: old commands that had been held up."

_AGE_DETAILS = {
    "stale": "It is older than its source's commands are good for.",
    "out_of_order": "A command with a later stamp was here before.",
    "from_the_future": "Its stamp is ahead of the clock by more than the timeout.",
}
