"""Limits the time for which a command is valid, because the board would obey it for ever."""

from __future__ import annotations

from typing import Literal, TypeAlias

from yahboomd.core.model import NS_PER_S

OnTimeout: TypeAlias = Literal["ramp", "halt"]
"""The reaction to silence: slow down within the limits, or stop at once."""


class Deadman:
    """Decides whether the command in effect has run out.

    The time counts from when the command was *given*, which may be earlier than its arrival. So a
    command that is delivered twice does not live longer.
    """

    def __init__(self, timeout_s: float) -> None:
        self.timeout_ns = round(timeout_s * NS_PER_S)
        self._given_ns: int | None = None

    @property
    def deadline_ns(self) -> int | None:
        """The end of the command; ``None`` without one."""
        return None if self._given_ns is None else self._given_ns + self.timeout_ns

    def feed(self, given_ns: int) -> None:
        self._given_ns = given_ns

    def clear(self) -> None:
        """Remove the command: expired until the next one."""
        self._given_ns = None

    def age_ns(self, now_ns: int) -> int | None:
        return None if self._given_ns is None else now_ns - self._given_ns

    def expired(self, now_ns: int) -> bool:
        return self._given_ns is None or now_ns - self._given_ns >= self.timeout_ns
