"""Writes black boxes in a thread: a disk that hangs holds up nothing."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, TypeVar

from msgspec import structs

from yahboomd.blackbox.box_file import (
    Header,
    NotABox,
    Saved,
    deflated,
    encode_header,
    read_box,
    robot_slug,
    segments_of,
)
from yahboomd.blackbox.ring_file import (
    SET_ASIDE,
    LeftRing,
    left_rings,
    set_aside,
    sweep_folders,
)
from yahboomd.blackbox.saved_boxes import save_box, saved_boxes
from yahboomd.core.clock import Clock, nanoseconds
from yahboomd.core.daemon.folder import prepare_folder

log = logging.getLogger(__name__)

Result = TypeVar("Result")

END_S = 0.7
"""The longest that the end of the daemon waits for a box, once the wheels stand."""

STUCK_S = 10.0

USUAL_NICE = 0
"""The thread goes behind the loop of a daemon of higher priority, but no further: it holds the
interpreter now and then, and the loop waits for it. At a niceness of 19 beside programs that kept
the machine busy, it did not run for seconds."""


class BoxOutcome(NamedTuple):
    """The result of writing a box.

    Attributes:
        path: Its file; None if it was not written.
        problem: The reason, if it was not.
    """

    path: Path | None
    problem: str = ""


class BoxWriter:
    """Writes one box at a time.

    Args:
        folder: The folder of saved boxes; None if there is none.

    Attributes:
        saved: Boxes that were written.
        failures: Boxes that were not.
        left: Rings that were left behind and are to be saved.
    """

    def __init__(self, folder: Path | None, rings: Path, clock: Clock) -> None:
        self._folder = folder
        self._rings = rings
        self._clock = clock
        self._thread: threading.Thread | None = None
        self._failing = False
        self._began_ns = 0
        self.saved = self.failures = self.left = 0

    @property
    def busy(self) -> bool:
        return self._thread is not None

    @property
    def works(self) -> bool:
        """Whether boxes can be saved: the last one was, and no disk has hung for 10 s."""
        stuck = self.busy and self._clock.now_ns() - self._began_ns > nanoseconds(STUCK_S)
        return not (stuck or self._failing)

    def find_rings(self, done: Callable[[int | None], None]) -> None:
        """Count the rings that earlier daemons left, and find the newest saved box.

        Args:
            done: Called on the loop with the time of the newest box, Unix nanoseconds.
        """
        wall_ns = self._clock.wall_ns()

        def job() -> int | None:
            sweep_folders(self._rings, os.geteuid(), wall_ns)
            with left_rings(self._rings) as (left, strange):
                self.left = len(left)
            for path in strange:
                self._damaged(path, "it is no file of this user, or larger than any ring")
            if self._folder is None:
                return None
            with contextlib.suppress(OSError):
                return max((box.written_ns for box in saved_boxes(self._folder)), default=None)
            return None

        self._start(job, done, lambda _: None)

    def save(self, header: Header, segments: bytes, done: Callable[[BoxOutcome], None]) -> None:
        """Write a box.

        Args:
            header: The header, with the reasons.
            segments: The copy of the ring.
        """
        self._start(lambda: self._write(header, segments), done, self._failed)

    def adopt(self, done: Callable[[BoxOutcome], None]) -> None:
        """Write a ring that was left behind as a box, and remove it."""
        wall_ns = self._clock.wall_ns()

        def job() -> BoxOutcome:
            with left_rings(self._rings) as (left, _):
                self.left = max(0, len(left) - 1)
                return (
                    self._adopted(left[0], wall_ns)
                    if left
                    else BoxOutcome(None, "there is none any more")
                )

        self._start(job, done, self._failed)

    def save_last(self, header: Header, segments: bytes) -> bool:
        """Write a box while the daemon ends; return whether it was written in 0.7 s."""
        written: list[BoxOutcome] = []
        thread = threading.Thread(
            target=lambda: written.append(self._write(header, segments)), daemon=True
        )
        thread.start()
        thread.join(END_S)
        return bool(written) and written[0].path is not None

    def end(self) -> bool:
        """Wait 0.7 s at most for the box that is being written; return whether it is."""
        if self._thread is None:
            return True
        self._thread.join(END_S)
        return not self._thread.is_alive()

    def _start(
        self,
        job: Callable[[], Result],
        done: Callable[[Result], None],
        instead: Callable[[str], Result],
    ) -> None:
        """Do a job in the thread.

        Args:
            done: Called on the loop with its result.
            instead: Reports the error of a job that raised, and returns its result.
        """
        loop = asyncio.get_running_loop()

        def ended(result: Result) -> None:
            self._thread = None
            done(result)

        def work() -> None:
            # The control path goes first.
            with contextlib.suppress(OSError):
                nice = max(USUAL_NICE, os.getpriority(os.PRIO_PROCESS, 0))
                os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), nice)
            try:
                result = job()
            except Exception as error:  # noqa: BLE001 - whatever it is, the next box is written
                result = instead(f"{type(error).__name__}: {error}"[:200])
            # The loop may be closed by now.
            with contextlib.suppress(RuntimeError):
                loop.call_soon_threadsafe(ended, result)

        self._began_ns = self._clock.now_ns()
        self._thread = threading.Thread(target=work, name="black-box", daemon=True)
        try:
            self._thread.start()
        except RuntimeError as error:
            # There is room for no more threads.
            self._thread = None
            done(instead(str(error)))

    def _write(self, header: Header, segments: bytes, *, whose: str = "The") -> BoxOutcome:
        assert header.saved is not None
        if self._folder is None:
            return self._failed("there is no state directory: name one with blackbox.folder")
        try:
            prepare_folder(self._folder)
            data = deflated(encode_header(header) + segments)
            path = save_box(
                self._folder,
                data,
                reason=header.saved.reasons[0],
                wall_ns=header.saved.wall_ns,
                robot=robot_slug(header),
            )
        except OSError as error:
            return self._failed(f"{self._folder}: {error.strerror or error}")
        self.saved += 1
        self._failing = False
        reasons = ", ".join(header.saved.reasons)
        log.info("%s black box was saved (%s): %s", whose, reasons, path)
        return BoxOutcome(path)

    def _adopted(self, ring: LeftRing, wall_ns: int) -> BoxOutcome:
        try:
            header = read_box(ring.data).header
            saved = Saved(reasons=ring.reasons, at_ns=0, wall_ns=wall_ns)
        except NotABox as error:
            return self._damaged(ring.path, str(error))
        header = structs.replace(header, saved=saved)
        # A start that says "(estop)" would seem to be stopped itself.
        outcome = self._write(header, segments_of(ring.data), whose="An earlier daemon's")
        if outcome.path is not None:
            ring.remove()
        return outcome

    def _damaged(self, path: Path, words: str) -> BoxOutcome:
        set_aside(path)
        self.failures += 1
        log.warning(
            "%s was left by an earlier daemon and cannot be saved (%s): it is now %s there.",
            path,
            words,
            path.with_suffix(SET_ASIDE).name,
        )
        return BoxOutcome(None, words)

    def _failed(self, words: str) -> BoxOutcome:
        self.failures += 1
        if not self._failing:
            self._failing = True
            log.warning(
                "The black box cannot be saved (%s). It goes on in memory, and nothing else is "
                "affected; further failures are counted.",
                words,
            )
        return BoxOutcome(None, words)
