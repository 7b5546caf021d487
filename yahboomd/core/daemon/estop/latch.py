"""The e-stop that outlives the process: the pure latch, and the thread that writes its file.

A disk that hangs delays no stop: the thread writes, and the newest state counts. A failed write is
retried until the latch is on file or the e-stop is released. A file that was removed meanwhile is
written again.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
from collections.abc import Callable, Sequence
from functools import partial

from msgspec import structs

from yahboomd.core.clock import nanoseconds
from yahboomd.core.daemon.estop.latch_file import LatchFile
from yahboomd.core.drive.estop import EmergencyStop, Latched, Release

log = logging.getLogger(__name__)

LOAD_WITHIN_S = 2.0
RELEASE_WITHIN_S = 0.5
"""The loop waits this long, once, for the file's removal: the robot stands meanwhile, and a slower
disk hangs."""

RETRY_S = 1.0
RESTORE_EVERY_S = 5.0
"""The period of the check that an engaged latch is on file. A runtime folder goes with the
last session of its user, and old files in /tmp are removed."""


class LatchKeeper:
    """Keeps the file in the state of the latch.

    Attributes:
        failures: How often the file could not be written or removed.
    """

    def __init__(self, file: LatchFile) -> None:
        self.failures = 0
        self._file = file
        self._state = threading.Condition()
        self._by: str | None = None
        self._wish = self._tried = self._done = self._changed = 0
        self._working = self._restoring = False
        self._failing = False
        self._hangs = False
        self._awaiting: list[Callable[[], object]] = []

    def load(self) -> str | None:
        """The origin of the latch that is on file; ``None`` if it is not engaged.

        A file that cannot be read in time counts as engaged.
        """
        found: list[str | None] = []
        reader = threading.Thread(
            target=lambda: found.append(self._file.load()), name="latch-load", daemon=True
        )
        reader.start()
        reader.join(LOAD_WITHIN_S)
        if found:
            return found[0]
        log.warning(
            "%s could not be read within %g s: the e-stop counts as engaged",
            self._file,
            LOAD_WITHIN_S,
        )
        return "unknown (its file could not be read in time)"

    def engage(self, by: str) -> None:
        """Have it put on file; returns at once. Each press checks that the file is there."""
        with self._state:
            self._ask(by)

    def release(self) -> bool:
        """Remove the file; return whether it is gone. If it is not, the caller engages again."""
        with self._state:
            if self._hangs:
                return False
            wish = self._ask(None)
            self._hangs = not self._state.wait_for(lambda: self._tried >= wish, RELEASE_WITHIN_S)
            return self._done >= wish

    @property
    def on_file(self) -> bool:
        return self._done >= self._changed

    @property
    def wish(self) -> int:
        return self._wish

    def has_done(self, wish: int) -> bool:
        """Whether a request, or a later one, was carried out."""
        return self._done >= wish

    def settled(self, within_s: float) -> bool:
        """Wait until the latest request is carried out; return whether it is."""
        with self._state:
            wish = self._wish
            return self._state.wait_for(lambda: self.has_done(wish), within_s)

    def when_tried(self, wish: int, call: Callable[[], object]) -> None:
        """Have something called after the next attempt, or now if the request is carried out."""
        with self._state:
            self._awaiting.append(call)
            if self.has_done(wish):
                self._call_awaiting()

    def _call_awaiting(self) -> None:
        awaiting, self._awaiting = self._awaiting, []
        for call in awaiting:
            # Its event loop may have ended.
            with contextlib.suppress(RuntimeError):
                call()

    def restore_file(self) -> None:
        """Have the file of an engaged latch written again if it was removed; returns at once."""
        with self._state:
            if self._by is not None and not self._working:
                self._restoring = True
                self._start()

    def _ask(self, by: str | None) -> int:
        self._wish += 1
        if by != self._by:
            self._by, self._changed = by, self._wish
        self._state.notify_all()
        self._start()
        return self._wish

    def _start(self) -> None:
        if not self._working:
            # If no thread can be started now, the next call has one.
            with contextlib.suppress(RuntimeError):
                threading.Thread(target=self._work, name="latch-file", daemon=True).start()
                self._working = True

    def _work(self) -> None:
        while True:
            with self._state:
                if self.has_done(self._wish) and not self._restoring:
                    self._working = False
                    return
                self._restoring = False
                wish, by = self._wish, self._by
            error: Exception | None = None
            try:
                if by is None:
                    self._file.release()
                else:
                    self._file.engage(by)
            except Exception as caught:  # noqa: BLE001 - the thread must live to try again
                error = caught
            with self._state:
                self._tried = wish
                self._hangs = False
                # One that was on file may be gone, and cannot be written again.
                self._done = wish if error is None else min(self._done, self._changed - 1)
                self._log_outcome(by, error)
                self._state.notify_all()
                self._call_awaiting()
                if error is not None:
                    self._await_another(wish)

    def _await_another(self, wish: int) -> None:
        self._state.wait_for(lambda: self._wish != wish, RETRY_S)

    def _log_outcome(self, by: str | None, error: Exception | None) -> None:
        if error is not None:
            self.failures += 1
            if by is None:
                log.warning(
                    "%s cannot be removed (%s): the e-stop stays engaged", self._file, error
                )
            elif not self._failing:
                self._failing = True
                log.warning(
                    "The e-stop is engaged, but %s cannot be written (%s), so it would not survive "
                    "a restart. yahboomd tries again every second.",
                    self._file,
                    error,
                )
        elif by is not None and self._failing:
            self._failing = False
            log.info("The e-stop is on file now: %s", self._file)


log = logging.getLogger(__name__)

SETTLE_S = 0.5
"""The longest that an acknowledgement, and the end of the daemon, wait for the file."""


class EstopLatch:
    """Engages, remembers, releases.

    Args:
        now_ns: Now; a latch on file counts as engaged since then.
        release: The command of a terminal that releases it.
    """

    def __init__(
        self, file: LatchFile, now_ns: int, *, release: str = "yahboomd stop --release"
    ) -> None:
        self._keeper = LatchKeeper(file)
        self._tried: asyncio.Event | None = None
        self._restored_ns = now_ns
        by = self._keeper.load()
        remembered = None
        if by is not None:
            log.warning(
                "The emergency stop is engaged, as it was when yahboomd last ran (by %s): "
                "the robot stands. To drive again: %s",
                by,
                release,
            )
            reason = "it was engaged when yahboomd last ran"
            remembered = Latched(reason=reason, by=by, since_ns=now_ns)
            # It may have been found under another name of the port.
            self._keeper.engage(by)
        self._stop = EmergencyStop(remembered)

    @property
    def engaged(self) -> bool:
        return self._stop.engaged

    @property
    def latched(self) -> Latched | None:
        latched = self._stop.latched
        if latched is None or self._keeper.on_file:
            return latched
        words = f"{latched.reason} (not on file: it would not survive a restart)"
        return structs.replace(latched, reason=words)

    def status_values(self) -> dict[str, int]:
        """For the status: whether an engaged latch is missing on file, and all failures."""
        missing = self.engaged and not self._keeper.on_file
        return {"estop_not_on_file": int(missing), "estop_file_failures": self._keeper.failures}

    def engage(self, by: str, now_ns: int) -> bool:
        """Engage; return whether it was released before. This does not wait for the disk."""
        return self._stop.engage("somebody asked for it", by, now_ns)

    def remember(self) -> None:
        """Have an engaged latch put on file, after the wheels were stopped; returns at once."""
        if self._stop.latched is not None:
            self._keeper.engage(self._stop.latched.by)

    def restore_file(self, now_ns: int) -> bool:
        """Have a removed file of an engaged latch written again; whether 5 s have passed again."""
        if now_ns - self._restored_ns < nanoseconds(RESTORE_EVERY_S):
            return False
        self._restored_ns = now_ns
        if self.engaged:
            self._keeper.restore_file()
        return True

    def settle(self) -> bool:
        """Wait half a second at most for the file; return whether it is as the latch. Blocks."""
        return self._keeper.settled(SETTLE_S)

    async def on_file(self) -> bool:
        """Whether an engaged latch is on file, within half a second."""
        keeper = self._keeper
        wish = keeper.wish
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(SETTLE_S):
                while not keeper.has_done(wish):
                    # While the disk hangs, the thread that writes calls one event for all.
                    tried = self._tried
                    if tried is None or tried.is_set():
                        tried = self._tried = asyncio.Event()
                        wake = asyncio.get_running_loop().call_soon_threadsafe
                        keeper.when_tried(wish, partial(wake, tried.set))
                    await tried.wait()
        return keeper.has_done(wish)

    def release(self, moving: Sequence[str]) -> Release:
        """Release, unless it would start the robot or the file cannot be removed."""
        latched = self._stop.latched
        release = self._stop.release(moving)
        if latched is None or not release.released or self._keeper.release():
            return release
        self._stop = EmergencyStop(latched)
        # It may be removed later than we waited.
        self._keeper.engage(latched.by)
        return Release(
            released=False,
            message="Still engaged: its file cannot be removed; see the log.",
        )
