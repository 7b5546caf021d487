"""The last pose of a robot: the next daemon continues from it, if the board went on counting.

It is in the folder of the rings, in memory, so that it lasts from daemon to daemon and no longer
than the boot: a computer that starts begins at the origin.
"""

from __future__ import annotations

import contextlib
import os
import zlib
from pathlib import Path

import msgspec

from yahboomd.blackbox.box_file import Header, settings_of
from yahboomd.core.model import Counts, OdometryEstimate

EVERY_NS = 200_000_000
SIZE = 2048
"""It is written in one piece, so that no kill leaves a half of it."""


class KeptPose(msgspec.Struct, frozen=True, kw_only=True):
    """The last estimate, and the board's counters that belong to it."""

    boot_id: str
    ticks: Counts
    estimate: OdometryEstimate


class PoseFile:
    """The file of one robot: of one port and one namespace.

    Args:
        resume: Whether a daemon is to continue from it.

    Attributes:
        last: The pose that an earlier daemon left in this boot; None without one.

    Raises:
        OSError: It cannot be made.
    """

    def __init__(self, folder: Path, header: Header, *, resume: bool = True) -> None:
        self._boot_id = header.boot_id
        self._written_ns = 0
        port = settings_of(header, "serial").get("port")
        robot = f"{port} {settings_of(header, 'zenoh').get('namespace')}"
        flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC | os.O_NONBLOCK
        path = folder / f"yahboomd-{zlib.crc32(robot.encode()):08x}.pose"
        self._fd = os.open(path, flags, 0o640)
        self.last: KeptPose | None = None
        with contextlib.suppress(msgspec.MsgspecError):
            kept = msgspec.json.decode(os.pread(self._fd, SIZE, 0), type=KeptPose)
            self.last = kept if resume and kept.boot_id == self._boot_id else None

    def keep(self, ticks: Counts, estimate: OdometryEstimate) -> None:
        """Keep it, five times a second at most."""
        if estimate.stamp_ns - self._written_ns >= EVERY_NS:
            self._written_ns = estimate.stamp_ns
            kept = KeptPose(boot_id=self._boot_id, ticks=ticks, estimate=estimate)
            os.pwrite(self._fd, msgspec.json.encode(kept).ljust(SIZE), 0)

    def close(self) -> None:
        os.close(self._fd)
