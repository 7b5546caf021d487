"""The e-stop with its memory: the pure latch, and the file that outlives the process."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from yahboomd.daemon.latch_file import LatchFile
from yahboomd.drive.estop import EmergencyStop, Latched, Release

log = logging.getLogger(__name__)


class EstopLatch:
    """Engages, remembers, releases.

    Args:
        file: Where it is remembered.
        now_ns: Now; what is on file counts as engaged since then.
    """

    def __init__(self, file: LatchFile, now_ns: int) -> None:
        self._file = file
        by = file.load()
        remembered = None
        if by is not None:
            log.warning(
                "The emergency stop is engaged, as it was when yahboomd last ran (by %s): "
                "the robot stands. To drive again: yahboomd stop --release",
                by,
            )
            reason = "it was engaged when yahboomd last ran"
            remembered = Latched(reason=reason, by=by, since_ns=now_ns)
        self._stop = EmergencyStop(remembered)

    @property
    def engaged(self) -> bool:
        """Whether the wheels must stand."""
        return self._stop.engaged

    @property
    def latched(self) -> Latched | None:
        """Who engaged it, when and why."""
        return self._stop.latched

    def engage(self, by: str, now_ns: int) -> bool:
        """Engage; whether that is news. The wheels are stopped by the caller, not by the disk."""
        return self._stop.engage("somebody asked for it", by, now_ns)

    def remember(self) -> None:
        """Write an engaged latch to its file; after the wheels were told to stop."""
        if self._stop.latched is not None:
            self._file.engage(self._stop.latched.by)

    def release(self, moving: Sequence[str]) -> Release:
        """Release, unless it would start the robot or the file cannot forget."""
        latched = self._stop.latched
        release = self._stop.release(moving)
        if release.released and not self._file.release():
            self._stop = EmergencyStop(latched)
            return Release(
                released=False,
                message="Still engaged: its file cannot be removed; the log says why.",
            )
        return release
