"""The e-stop with its memory: the pure latch, and the file that outlives the process."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Sequence

from msgspec import structs

from yahboomd.daemon.latch_file import LatchFile
from yahboomd.daemon.latch_keeper import LatchKeeper
from yahboomd.drive.estop import EmergencyStop, Latched, Release

log = logging.getLogger(__name__)

SETTLE_S = 0.5
"""An acknowledgement, and the end of the daemon, wait so long for the file."""


class EstopLatch:
    """Engages, remembers, releases.

    Args:
        file: Where it is remembered.
        now_ns: Now; what is on file counts as engaged since then.
    """

    def __init__(self, file: LatchFile, now_ns: int) -> None:
        self._keeper = LatchKeeper(file)
        self._settling: asyncio.Future[bool] | None = None
        by = self._keeper.load()
        remembered = None
        if by is not None:
            log.warning(
                "The emergency stop is engaged, as it was when yahboomd last ran (by %s): "
                "the robot stands. To drive again: yahboomd stop --release",
                by,
            )
            reason = "it was engaged when yahboomd last ran"
            remembered = Latched(reason=reason, by=by, since_ns=now_ns)
            # It may have been found under an older name.
            self._keeper.engage(by)
        self._stop = EmergencyStop(remembered)

    @property
    def engaged(self) -> bool:
        """Whether the wheels must stand."""
        return self._stop.engaged

    @property
    def latched(self) -> Latched | None:
        """Who engaged it, when and why."""
        latched = self._stop.latched
        if latched is None or self._keeper.on_file:
            return latched
        words = f"{latched.reason} (not on file: it would not survive a restart)"
        return structs.replace(latched, reason=words)

    def facts(self) -> dict[str, int]:
        """For the status: whether an engaged latch is missing on file, and failures so far."""
        missing = self.engaged and not self._keeper.on_file
        return {"estop_not_on_file": int(missing), "estop_file_failures": self._keeper.failures}

    def engage(self, by: str, now_ns: int) -> bool:
        """Engage; whether that is news. The wheels are stopped by the caller, not by the disk."""
        return self._stop.engage("somebody asked for it", by, now_ns)

    def remember(self) -> None:
        """Have an engaged latch put on file, after the wheels were stopped; returns at once."""
        if self._stop.latched is not None:
            self._keeper.engage(self._stop.latched.by)

    def settle(self) -> bool:
        """Wait for the file, for half a second at most; whether it is as the latch is. Blocks."""
        return self._keeper.settled(SETTLE_S)

    async def on_file(self) -> bool:
        """Whether an engaged latch is on file, within half a second."""
        if self._keeper.on_file:
            return True
        # However many ask while the disk hangs, one thread waits.
        if self._settling is None or self._settling.done():
            self._settling = asyncio.ensure_future(asyncio.to_thread(self.settle))
        return await asyncio.shield(self._settling)

    def release(self, moving: Sequence[str]) -> Release:
        """Release, unless it would start the robot or the file cannot forget."""
        latched = self._stop.latched
        release = self._stop.release(moving)
        if latched is None or not release.released or self._keeper.release():
            return release
        self._stop = EmergencyStop(latched)
        # It may be removed later than we waited.
        self._keeper.engage(latched.by)
        return Release(
            released=False,
            message="Still engaged: its file cannot be removed; the log says why.",
        )
