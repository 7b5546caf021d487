"""The velocity to publish now: a command until its deadline, then zeros, then nothing.

A zero command holds control of the robot as any other does, so the zeros end as well. Pure: callers
pass monotonic nanoseconds.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

from yahboomd.core.model import STANDSTILL, Twist2d

ZEROS_NS = 300_000_000
"""How long zeros are published after motion: seven at 20 Hz, of which one has to arrive."""

End: TypeAlias = Literal["", "time", "stop", "interrupted", "paused"]
"""The cause that ended the latest command: its time, a stop, a lost daemon, or a pause."""


class Repeater:
    """The command of one client."""

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
