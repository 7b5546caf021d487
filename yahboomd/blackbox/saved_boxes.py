"""The folder of saved black boxes: bounded in files and bytes, each written whole or not at all.

The first box is kept, and the newest ones: the beginning of a series of faults is worth as much as
its end. Every call may block on the disk.
"""

from __future__ import annotations

import contextlib
import errno
import os
import re
import stat
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from yahboomd.core.atomic_write import write_atomic
from yahboomd.core.model import NS_PER_S

FILES_MOST = 20
BYTES_MOST = 8 << 20

ROOM_BYTES = 16 << 20
"""With less room on the disk nothing is saved: the robot's other files are worth more."""

SUFFIX = ".blackbox"
_NAME = re.compile(
    r"(?P<number>\d{6,})_(?P<stamp>\d{8}T\d{6}Z)_(?P<reason>[a-z_]+)"
    r"(\.(?P<robot>[A-Za-z0-9-]+))?\.blackbox"
)
_UNFINISHED = f".*{SUFFIX}.*"
_UNFINISHED_NS = 600 * NS_PER_S


class SavedBox(NamedTuple):
    """A saved box.

    Attributes:
        number: Each has the number after the largest of those before.
        written_ns: When it was written, by its file; Unix nanoseconds.
    """

    number: int
    path: Path
    size: int
    written_ns: int


def saved_boxes(folder: Path) -> list[SavedBox]:
    """The boxes in a folder, the oldest first.

    Raises:
        OSError: The folder cannot be read.
    """
    found = []
    try:
        paths = list(folder.iterdir())
    except FileNotFoundError:
        return []
    for path in paths:
        if (match := _NAME.fullmatch(path.name)) is not None:
            with contextlib.suppress(FileNotFoundError):
                status = path.lstat()
                if not stat.S_ISREG(status.st_mode):
                    continue
                number = int(match["number"])
                found.append(SavedBox(number, path, status.st_size, status.st_mtime_ns))
    return sorted(found)


def save_box(folder: Path, data: bytes, *, reason: str, wall_ns: int, robot: str = "") -> Path:
    """Write a box, and remove others until there is room for it; returns its file.

    Args:
        folder: An existing folder.
        reason: In a word.
        robot: Its name, for the file's.

    Raises:
        OSError: The disk is full, gone or read-only. No part of the file remains.
    """
    _sweep(folder, wall_ns)
    room = os.statvfs(folder)
    if room.f_bavail * room.f_frsize < ROOM_BYTES:
        raise OSError(errno.ENOSPC, f"less than {ROOM_BYTES >> 20} MiB are free", str(folder))
    _make_room(folder, len(data))
    stamp = datetime.fromtimestamp(wall_ns * 1e-9, UTC).strftime("%Y%m%dT%H%M%SZ")

    def is_last(_: Path) -> None:
        # Another daemon may have saved into the same folder.
        if any(box.number >= number for box in saved_boxes(folder)):
            raise FileExistsError

    while True:
        number = max((box.number for box in saved_boxes(folder)), default=0) + 1
        path = folder / f"{number:06}_{stamp}_{reason}{robot and f'.{robot}'}{SUFFIX}"
        with contextlib.suppress(FileExistsError):
            # A robot that has stopped for a reason is often switched off next.
            write_atomic(path, data, mode=0o640, check=is_last, replace=False)
            return path


def _make_room(folder: Path, size: int) -> None:
    """Remove the oldest ones but the first."""
    boxes = saved_boxes(folder)
    while len(boxes) > 1 and (
        len(boxes) >= FILES_MOST or sum(box.size for box in boxes) + size > BYTES_MOST
    ):
        with contextlib.suppress(FileNotFoundError):
            boxes.pop(1).path.unlink()


def _sweep(folder: Path, wall_ns: int) -> None:
    for path in folder.glob(_UNFINISHED):
        with contextlib.suppress(FileNotFoundError):
            if wall_ns - path.stat().st_mtime_ns > _UNFINISHED_NS:
                path.unlink()
