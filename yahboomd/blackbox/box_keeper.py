"""The black box of the daemon: its records, and the events that save it.

The ring is in memory that outlives the process. It is saved a second after an event that stops the
robot for a reason, so that it shows how the robot came to rest: copied on the loop, compressed and
written by a thread. A disk that is full, slow or gone is counted, and reported once. A ring that
was left behind is saved by the next daemon of the same user.
"""

from __future__ import annotations

import asyncio
import logging
import os
import platform
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from msgspec import structs

from yahboomd import __version__
from yahboomd.blackbox.box_file import Header, ImuSettings, Saved
from yahboomd.blackbox.box_writer import BoxOutcome, BoxWriter
from yahboomd.blackbox.kept_pose import PoseFile
from yahboomd.blackbox.recorded_odometer import odometer
from yahboomd.blackbox.recorder import Recorder
from yahboomd.blackbox.records import Ended
from yahboomd.blackbox.ring_file import SEGMENT_BYTES, RingFile, ring_folder
from yahboomd.core.clock import Clock, nanoseconds, seconds
from yahboomd.core.config import Config, runtime_folder
from yahboomd.core.config.models import blackbox_folder
from yahboomd.core.daemon.assembly import odometer_settings
from yahboomd.core.daemon.black_box import NAME
from yahboomd.core.daemon.folder import prepare_folder
from yahboomd.core.daemon.process import without_age
from yahboomd.core.daemon.recorders import Recorders
from yahboomd.core.link.tap import NO_TAP, Tap
from yahboomd.core.messages.native import ServiceReply, StatusSample
from yahboomd.core.model import Event, EventKind
from yahboomd.core.odometry.odometer import Odometer, OdometerSettings

log = logging.getLogger(__name__)

REASONS: dict[EventKind, str] = {
    "estop": "estop",
    "disconnected": "disconnected",
    "runaway_against": "runaway",
    "runaway_fast": "runaway",
    "turns_without_command": "runaway",
    "no_counts": "fault",
    "stop_not_obeyed": "fault",
    "stop_not_seen": "fault",
    "reset_loop": "fault",
}
"""The events that save the box, and the word for each."""

ASKED = "asked"

ANSWER_S = 3.0
"""A client that asks for a box is answered within this time."""

AFTERMATH_S = 1.0
"""The wheels stand a second after a stop, and the box shows it."""

AGAIN_S = 60.0
"""It is saved no more often: the next one holds a minute, and so all that comes in between."""


class BoxKeeper:
    """Records, and saves. Made on the running loop.

    Attributes:
        recorder: Takes the records; None if nothing is recorded.
    """

    def __init__(
        self,
        config: Config,
        clock: Clock,
        environ: Mapping[str, str],
        recorders: Recorders | None = None,
    ) -> None:
        self._clock = clock
        self._recorders = recorders or Recorders()
        self._header = header(config, clock)
        self._file: RingFile | None = None
        self._poses: PoseFile | None = None
        self._resume = config.odometry.on_restart == "continue"
        self.recorder: Recorder | None = None
        self._reasons: list[str] = []
        self._saving: tuple[str, ...] = ()
        self._due_ns = 0
        self._saved_ns: int | None = None
        self._adopted_ns: int | None = None
        self._last = ""
        self._newest = ("", "")
        """What became of the newest save, in words, and its name or the problem."""
        self._asked: list[asyncio.Future[BoxOutcome]] = []
        folder = ring_folder(runtime_folder(environ, user_id=os.getuid()), os.getuid())
        self._writer = BoxWriter(
            blackbox_folder(config, environ, None, user_id=os.getuid()),
            folder or Path(os.devnull),
            clock,
        )
        self._alarm = clock.alarm(self._recorders.guarded(NAME, self._save))
        if config.blackbox.enabled:
            self._recorders.call(NAME, self._open, folder)

    def _open(self, folder: Path | None) -> None:
        clock = self._clock
        if folder is None:
            log.warning(
                "No black box is kept: neither the runtime folder nor /dev/shm is in memory "
                "(tmpfs). The robot drives as ever."
            )
            return
        try:
            self._file = self._made(folder)
            self._poses = PoseFile(folder, self._header, resume=self._resume)
        except OSError as error:
            log.warning(
                "No black box is kept: %s cannot be used for it (%s). The robot drives as ever.",
                folder,
                error.strerror or error,
            )
            return
        recorder = Recorder(self._file.ring, clock.now_ns, clock.wall_ns)
        self._recorders.guard(NAME, recorder)
        self._recorders.guard(NAME, self._poses)
        self.recorder = recorder
        self._writer.find_rings(self._recorders.guarded(NAME, self._looked))

    def _made(self, folder: Path) -> RingFile:
        prepare_folder(folder)
        try:
            return RingFile(folder, self._header)
        except FileNotFoundError:
            # Another daemon ended, and removed the folder because it was empty.
            prepare_folder(folder)
            return RingFile(folder, self._header)

    @property
    def _recording(self) -> bool:
        return self.recorder is not None and self._recorders.works(NAME)

    @property
    def tap(self) -> Tap:
        return self.recorder or NO_TAP

    def odometer(self, settings: OdometerSettings) -> Odometer:
        return odometer(settings, self.recorder, self._poses)

    def status_values(self) -> dict[str, Any]:
        writer, file = self._writer, self._file
        return {
            "blackbox_recording": int(self._recording),
            "blackbox_saving": int(self._recording and writer.works),
            "blackbox_saved": writer.saved,
            "blackbox_failures": writer.failures,
            "blackbox_left_out": 0 if file is None else file.ring.left_out,
            "blackbox_last": self._last,
        }

    # Records besides those of the line.

    def event(self, event: Event) -> None:
        """Record an event; some events save the box."""
        if self.recorder is None or not self._recording:
            return
        self.recorder.event(event)
        if (reason := REASONS.get(event.kind)) is not None:
            self._trigger(reason, AFTERMATH_S)

    def status(self, sample: StatusSample) -> None:
        """Record who drives and why the robot stands, when that changes."""
        if self.recorder is not None:
            self.recorder.decision(sample.state, sample.driver or "", without_age(sample.why))

    # When it is saved.

    async def save_now(self) -> ServiceReply:
        if not self._recording:
            return ServiceReply(
                success=False,
                message="No black box is kept: see blackbox.enabled, and recorders_off in the "
                "status.",
            )
        wait_s = self._wait_s()
        self._trigger(ASKED, 0.0)
        if wait_s > 0.0:
            words = (
                f"A black box {self._newest[0]} {AGAIN_S - wait_s:.0f} s ago ({self._newest[1]}): "
                f"it is saved again in {wait_s:.0f} s, and reaches back to that moment."
            )
            return ServiceReply(success=True, message=words)
        done: asyncio.Future[BoxOutcome] = asyncio.get_running_loop().create_future()
        self._asked.append(done)
        try:
            async with asyncio.timeout(ANSWER_S):
                outcome = await done
        except TimeoutError:
            words = f"The disk took longer than {ANSWER_S:g} s: see the log."
            return ServiceReply(success=False, message=words)
        if outcome.path is None:
            return ServiceReply(success=False, message=f"Not saved: {outcome.problem}.")
        return ServiceReply(
            success=True, message=f"Saved to {outcome.path}.", data={"path": str(outcome.path)}
        )

    def _trigger(self, reason: str, after_s: float) -> None:
        due_ns = self._clock.now_ns() + nanoseconds(after_s)
        self._due_ns = min(self._due_ns, due_ns) if self._reasons else due_ns
        if reason not in self._reasons:
            self._reasons.append(reason)
        self._schedule()

    def _wait_s(self) -> float:
        if self._saved_ns is None:
            return 0.0
        return AGAIN_S - seconds(self._clock.now_ns() - self._saved_ns)

    def _schedule(self) -> None:
        if self._writer.busy or not (self._reasons or self._writer.left):
            return
        now_ns = self._clock.now_ns()
        due_ns = self._own_due_ns() if self._reasons else self._left_due_ns()
        if self._writer.left:
            due_ns = min(due_ns, self._left_due_ns())
        self._alarm.set(max(due_ns, now_ns))

    def _own_due_ns(self) -> int:
        """A box of its own waits for no ring of an earlier daemon: a person may wait for it."""
        if self._saved_ns is None:
            return self._due_ns
        return max(self._due_ns, self._saved_ns + nanoseconds(AGAIN_S))

    def _left_due_ns(self) -> int:
        written = [each for each in (self._saved_ns, self._adopted_ns) if each is not None]
        return max(written) + nanoseconds(AGAIN_S) if written else 0

    def _save(self) -> None:
        """Save it now; afterwards the rings that were left behind, one by one."""
        file = self._file
        if self._writer.busy or file is None:
            return
        now_ns = self._clock.now_ns()
        if self._writer.left and (not self._reasons or now_ns < self._own_due_ns()):
            self._adopted_ns = now_ns
            self._writer.adopt(self._recorders.guarded(NAME, self._adopted))
            return
        self._saved_ns = now_ns
        self._newest = ("began to be saved", "it is not done yet")
        reasons, self._reasons = tuple(self._reasons), []
        self._saving = reasons
        asked, self._asked = tuple(self._asked), []
        done = self._recorders.guarded(NAME, partial(self._finished, asked))
        self._writer.save(self._image(reasons), file.segments(), done)

    def _image(self, reasons: tuple[str, ...]) -> Header:
        clock = self._clock
        saved = Saved(reasons=reasons, at_ns=clock.now_ns(), wall_ns=clock.wall_ns())
        return structs.replace(self._header, saved=saved)

    def _looked(self, newest_ns: int | None) -> None:
        """Note the newest box of earlier daemons: it may have been saved just now."""
        if newest_ns is not None:
            age_ns = self._clock.wall_ns() - newest_ns
            if 0 <= age_ns < nanoseconds(AGAIN_S):
                self._saved_ns = self._clock.now_ns() - age_ns
                self._newest = ("was saved", "by an earlier daemon")
        self._schedule()

    def _adopted(self, outcome: BoxOutcome) -> None:
        if outcome.path is not None:
            self._last = outcome.path.name
        self._schedule()

    def _finished(self, asked: tuple[asyncio.Future[BoxOutcome], ...], outcome: BoxOutcome) -> None:
        if outcome.path is None:
            self._newest = ("could not be saved", outcome.problem)
        else:
            self._last = outcome.path.name
            self._newest = ("was saved", self._last)
        for future in asked:
            if not future.done():
                future.set_result(outcome)
        self._schedule()

    def close(self, error: BaseException | None) -> None:
        """End it after the wheels were stopped, with a last save if one is due: 1.4 s at most.

        Args:
            error: The fault that ends the daemon; None for a normal end.
        """
        self._alarm.close()
        if self._poses is not None:
            self._poses.close()
        file, recorder = self._file, self.recorder
        if file is None or recorder is None:
            return
        self._file = None
        reasons = ("crash", *self._reasons) if error is not None else tuple(self._reasons)
        idle = self._writer.end()
        if not idle:
            # It may never be written.
            reasons = (*reasons, *self._saving)
        keep = False
        if reasons:
            recorder.record(Ended(reasons=reasons, error="" if error is None else _words(error)))
            early = not idle or self._wait_s() > 0.0
            keep = early or not self._writer.save_last(self._image(reasons), file.segments())
        file.close(keep=keep)


def _words(error: BaseException) -> str:
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    return f"{type(error).__name__}: {error}"[:400]


def header(config: Config, clock: Clock) -> Header:
    """The facts about all records of this daemon.

    The configuration has no credentials: those are in the file that ``zenoh.config`` names.
    """
    imu = config.imu
    return Header(
        version=__version__,
        machine=platform.machine(),
        boot_id=_boot_id(),
        pid=os.getpid(),
        started_ns=clock.now_ns(),
        started_wall_ns=clock.wall_ns(),
        config=config.resolved().as_data(),
        profile=config.profile().name,
        odometer=odometer_settings(config),
        imu=ImuSettings(
            axes=imu.axes,
            gyro_axes=imu.gyro_axes or imu.axes,
            gyro_factor=imu.gyro_scale or 1.0,
        ),
        segment_bytes=SEGMENT_BYTES,
    )


def _boot_id() -> str:
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    except OSError:
        return ""
