"""The black box as the daemon sees it: it is told everything, and nothing depends on it.

`yahboomd run` hands in the one of :mod:`yahboomd.blackbox`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from msgspec import structs

from yahboomd.core.clock import Clock
from yahboomd.core.config import Config
from yahboomd.core.daemon.recorders import Recorders
from yahboomd.core.link.tap import NO_TAP, Tap
from yahboomd.core.messages.native import ServiceReply, StatusSample
from yahboomd.core.model import STANDSTILL, Event, Twist2d
from yahboomd.core.odometry.odometer import Odometer, OdometerSettings

NAME = "The black box"
"""The name by which its failure is reported."""


class CommandRecorder(Protocol):
    """Records commands."""

    def command(self, source: str, twist: Twist2d = STANDSTILL, refused: str = "") -> None:
        """Record an accepted or refused command; an unreadable one has no twist."""


class KeptBox(Protocol):
    """The black box of a daemon, which records or is switched off."""

    @property
    def recorder(self) -> CommandRecorder | None:
        """Takes the commands; None if nothing is recorded."""

    @property
    def tap(self) -> Tap:
        """Sees the bytes of the line."""

    def odometer(self, settings: OdometerSettings) -> Odometer:
        """Make the daemon's odometer; its inputs are recorded."""

    def event(self, event: Event) -> None:
        """Record an event; some events save the box."""

    def status(self, sample: StatusSample) -> None:
        """Record who drives and why the robot stands, when that changes."""

    def status_values(self) -> Mapping[str, Any]:
        """Its counters in the status."""

    async def save_now(self) -> ServiceReply:
        """Save it because a client asks for it."""

    def close(self, error: BaseException | None) -> None:
        """End it after the wheels were stopped.

        Args:
            error: The fault that ends the daemon; None for a normal end.
        """


class NoBlackBox:
    """In the place of one that could not be made."""

    recorder = None
    tap = NO_TAP

    def odometer(self, settings: OdometerSettings) -> Odometer:
        return Odometer(**structs.asdict(settings))

    def event(self, event: Event) -> None:
        pass

    def status(self, sample: StatusSample) -> None:
        pass

    def status_values(self) -> Mapping[str, Any]:
        return {"blackbox_recording": 0, "blackbox_saving": 0}

    async def save_now(self) -> ServiceReply:
        return ServiceReply(
            success=False, message="No black box could be made: see recorders_off in the status."
        )

    def close(self, error: BaseException | None) -> None:
        pass


class MakesBlackBox(Protocol):
    """Makes the black box of a daemon, on the running loop."""

    def __call__(
        self, config: Config, clock: Clock, environ: Mapping[str, str], recorders: Recorders
    ) -> KeptBox:
        """Make it. It has the recorders call whatever may fail."""
