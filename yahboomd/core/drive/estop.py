"""The emergency stop: a latch that any client may close and only one deliberate act opens.

It has no file and no bus: the caller stores :attr:`EmergencyStop.latched` so that it survives a
restart, and passes it in at the next start.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

if TYPE_CHECKING:
    from collections.abc import Sequence


class Latched(msgspec.Struct, frozen=True, kw_only=True):
    """An emergency stop in force.

    Attributes:
        reason: The reason, in the words of the person or program that engaged it.
        by: The person or program, such as the key or the command.
        since_ns: When it was engaged; monotonic nanoseconds (which outlive a restart of the
            service, as the runtime directory does).
    """

    reason: str
    by: str
    since_ns: int


class Release(msgspec.Struct, frozen=True, kw_only=True):
    """The result of a request to release it.

    Attributes:
        released: Whether the robot may move again.
        message: One sentence: the outcome, or the reason why not.
    """

    released: bool
    message: str


class EmergencyStop:
    """The latch.

    Args:
        latched: The emergency stop in force when the service last ran.
    """

    def __init__(self, latched: Latched | None = None) -> None:
        self.latched = latched

    @property
    def engaged(self) -> bool:
        return self.latched is not None

    def engage(self, reason: str, by: str, now_ns: int) -> bool:
        """Engage. Returns whether it was released before; if not, the first reason stays."""
        if self.latched is not None:
            return False
        self.latched = Latched(reason=reason, by=by, since_ns=now_ns)
        return True

    def release(self, moving: Sequence[str]) -> Release:
        """Let the robot move again, unless it would start at once.

        Args:
            moving: The sources that command motion now (``Arbiter.moving_sources``).
        """
        if self.latched is None:
            return Release(released=True, message="The emergency stop was not engaged.")
        if moving:
            return Release(
                released=False,
                message=(
                    f"Still engaged: {', '.join(moving)} commands motion, or did within the last "
                    "second, and the robot might start at once. Let go of the controls, wait a "
                    "second, then release it again."
                ),
            )
        by = self.latched.by
        self.latched = None
        return Release(released=True, message=f"Released the emergency stop that {by} engaged.")
