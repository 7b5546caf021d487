"""One source of commands: their age, whether they were held up, and its newest wish."""

from __future__ import annotations

from typing import Literal, TypeAlias

from yahboomd.core.drive.age import Age, AgeJudge, AgeRefusal, StampPolicy
from yahboomd.core.drive.arbitration import AllowedSource
from yahboomd.core.drive.backlog import BacklogGate
from yahboomd.core.drive.clock_offset import ClockOffset
from yahboomd.core.drive.deadman import Deadman
from yahboomd.core.drive.rhythm import Rhythm
from yahboomd.core.model import Twist2d

MOVING_NS = 1_000_000_000
"""A source counts as commanding motion for this time after its last command for motion. It spans
several periods of any usual sender; copies of a command come within a few milliseconds."""

Held: TypeAlias = Literal["revoke", "refuse"]
"""The command is part of a backlog (:mod:`~yahboomd.core.drive.backlog`)."""


class CommandSource:
    """Judges and keeps the commands of one source.

    Attributes:
        wish: Its newest command that was not held up, in control or not.
    """

    def __init__(self, source: AllowedSource, stamps: StampPolicy) -> None:
        self.source = source
        self.deadman = Deadman(source.timeout_s)
        timeout_ns = self.deadman.timeout_ns
        self.judge = AgeJudge(stamps, timeout_ns)
        self.offset = ClockOffset(stamps, timeout_ns)
        self.gate = BacklogGate(timeout_ns)
        self.rhythm = Rhythm(source)
        self.wish: Twist2d | None = None
        self._stamps = stamps
        self._moved_ns: int | None = None
        self._latest: tuple[Twist2d, int | None] | None = None

    def admit(
        self,
        twist: Twist2d,
        now_ns: int,
        stamp_ns: int | None,
        *,
        by_sender: bool,
        wall_ns: int | None,
        arrivals: int,
    ) -> Age | AgeRefusal | Held:
        """Judge a command that arrived; for the arguments see ``Arbiter.offer``."""
        if by_sender or self._stamps == "absolute":
            # Stamps of the transport may run half a second ahead of their sender's clock.
            self.offset.saw(now_ns, stamp_ns, wall_ns)
        age = self.judge.judge(now_ns, stamp_ns, by_sender=by_sender, wall_ns=wall_ns)
        latest, latest_stamp_ns = self._latest or (None, None)
        alike = arrivals == 1 and twist == latest
        stamped = stamp_ns is not None and stamp_ns > 0 and self._stamps != "ignore"
        verdict = self.gate.arrive(
            now_ns,
            arrivals=arrivals,
            proven=isinstance(age, Age) and age.proven,
            copy=stamped and alike and stamp_ns == latest_stamp_ns,
            alike=alike,
        )
        self._latest = twist, stamp_ns
        return age if verdict == "pass" else verdict

    def feed(self, twist: Twist2d, given_ns: int) -> None:
        self.wish = twist
        self.deadman.feed(given_ns)

    def drop(self) -> None:
        self.wish = None
        self.deadman.clear()

    def in_effect(self, now_ns: int) -> Twist2d | None:
        """The velocity that it wants; ``None`` if the command ran out or was revoked."""
        return None if self.deadman.expired(now_ns) else self.wish

    def note_motion(self, now_ns: int) -> None:
        """Record that it commands motion, by this command or by one that was lost unread."""
        self._moved_ns = max(now_ns, self._moved_ns or now_ns)

    def commands_motion(self, now_ns: int) -> bool:
        """Whether it commands motion, or did within the last second, obeyed or refused."""
        wish = self.in_effect(now_ns)
        if wish is not None and not wish.is_zero:
            return True
        return self._moved_ns is not None and now_ns - self._moved_ns < MOVING_NS
