"""The file of a ring: in memory that outlives the process, and locked while its daemon lives.

A ring without a lock was left behind, by a daemon that was killed or that could not save it.
The file lies in memory (a tmpfs): a write to a file on a disk may have to wait for the disk, and
the control loop with it. If no memory is mounted there is no ring.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import re
import secrets
import zlib
from collections.abc import Iterator
from pathlib import Path
from stat import S_ISDIR, S_ISREG

from yahboomd.blackbox.box_file import Header, encode_header, read_box, robot_slug
from yahboomd.blackbox.records import Ended
from yahboomd.blackbox.ring import Ring
from yahboomd.core.model import NS_PER_S

SEGMENTS = 16
SEGMENT_BYTES = 48 * 1024
"""The newest fifteen segments are always there: 720 KiB, 12 kB for each of 60 s.

The boards of this house send 6.6 kB/s at most, with the overhead of each record: a
four-channel board sends 169 lines of 32 bytes a second, each in a read of its own. Its commands and
their repeats are 1.9 kB/s, the commands from the bus, at most 100 a second, 3.5 kB/s.
"""

SUFFIX = ".ring"
UNFINISHED = ".ring-new"
LEFT_MOST = 4
"""This many left rings are kept for the next start: the first one and the newest."""

SET_ASIDE = ".ring-damaged"

LARGEST = 4 << 20
"""The largest ring."""

_TO_READ = os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC | os.O_NONBLOCK
_MEMORY = Path("/dev/shm")  # noqa: S108 - its entries are checked before they are used
_OLD_NS = 86_400 * NS_PER_S
_IN_MEMORY = {"tmpfs", "ramfs", "rootfs"}


def ring_folder(runtime: Path, user_id: int) -> Path | None:
    """The folder of the rings; None if no memory is mounted for it, because a disk may block.

    It is the runtime folder, or one in /dev/shm if that is on a disk.

    Args:
        runtime: The runtime folder, which need not be there yet.
    """
    there = next(each for each in (runtime, *runtime.parents) if each.exists())
    if _file_system(there) in _IN_MEMORY:
        return runtime
    if not _MEMORY.is_dir() or _file_system(_MEMORY) not in _IN_MEMORY:
        return None
    return _MEMORY / f"yahboomd-{user_id}-{zlib.crc32(os.fsencode(runtime)):08x}"


def leave_folder(folder: Path) -> None:
    """Remove a folder in /dev/shm once no ring is in it."""
    if folder.parent == _MEMORY:
        with contextlib.suppress(OSError):
            os.rmdir(folder)


def sweep_folders(own: Path, user_id: int, wall_ns: int) -> None:
    """Remove folders that daemons with other runtime folders left in /dev/shm a day ago or more."""
    for folder in _MEMORY.glob(f"yahboomd-{user_id}-*"):
        with contextlib.suppress(OSError):
            status = os.lstat(folder)
            old = wall_ns - status.st_mtime_ns > _OLD_NS
            if folder == own or status.st_uid != user_id or not S_ISDIR(status.st_mode) or not old:
                continue
            for path in folder.iterdir():
                if wall_ns - path.stat().st_mtime_ns > _OLD_NS and not is_live(path):
                    os.unlink(path)
            os.rmdir(folder)


def _file_system(folder: Path) -> str:
    device = os.stat(folder).st_dev
    number = f"{os.major(device)}:{os.minor(device)}"
    with contextlib.suppress(OSError):
        for line in Path("/proc/self/mountinfo").read_text(errors="replace").splitlines():
            before, _, behind = line.partition(" - ")
            if before.split(" ")[2] == number:
                return behind.split(" ")[0]
    return ""


class RingFile:
    """A ring in a file of its own.

    It is written and never mapped: a store to a mapping that another process cuts short ends the
    daemon (SIGBUS). A file that is cut loses records, and grows again with the next one.

    Raises:
        OSError: It cannot be made: the folder is full or read-only.
    """

    def __init__(self, folder: Path, header: Header) -> None:
        head = encode_header(header)
        self._head_bytes = len(head)
        self._size = len(head) + SEGMENTS * header.segment_bytes
        name = "-".join(filter(None, (robot_slug(header), secrets.token_hex(4))))
        self._path = folder / f"blackbox-{name}{SUFFIX}"
        unfinished = self._path.with_suffix(UNFINISHED)
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
        fd = self._fd = os.open(unfinished, flags, 0o640)
        try:
            os.fchmod(fd, 0o640)
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # A lack of memory shows here, and not when the first records are written.
            os.posix_fallocate(fd, 0, self._size)
            self._store(head, 0)
            os.rename(unfinished, self._path)
        except OSError:
            os.close(fd)
            os.unlink(unfinished)
            raise
        self.ring = Ring(self._store, len(head), header.segment_bytes, SEGMENTS)

    def _store(self, data: bytes, at: int) -> None:
        # After it was closed, another file may have its number.
        if self._fd >= 0 and os.pwrite(self._fd, data, at) != len(data):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def segments(self) -> bytes:
        """A copy of its content, without the header.

        Raises:
            OSError: It cannot be read.
        """
        return os.pread(self._fd, self._size - self._head_bytes, self._head_bytes)

    def close(self, *, keep: bool) -> None:
        """Close it; nothing is recorded any more.

        Args:
            keep: Leave the file for the next start.
        """
        if not keep:
            with contextlib.suppress(OSError):
                os.unlink(self._path)
            leave_folder(self._path.parent)
        fd, self._fd = self._fd, -1
        if fd >= 0:
            os.close(fd)


class LeftRing:
    """A ring that was left behind, locked until it is saved."""

    def __init__(self, path: Path, data: bytes) -> None:
        self.path = path
        self.data = data

    @property
    def reasons(self) -> tuple[str, ...]:
        """The reasons to save it: those that its daemon recorded, else that it was killed.

        Raises:
            NotABox: It is no black box.
        """
        for record in reversed(read_box(self.data).records):
            if isinstance(record.meaning, Ended) and record.meaning.reasons:
                # They become part of a file's name.
                if all(re.fullmatch("[a-z_]+", each) for each in record.meaning.reasons):
                    return record.meaning.reasons
                break
        return ("killed",)

    def remove(self) -> None:
        with contextlib.suppress(OSError):
            os.unlink(self.path)
        leave_folder(self.path.parent)


def rings(folder: Path) -> list[Path]:
    found = []
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            if path.suffix == SUFFIX and path.name.startswith("blackbox-"):
                with contextlib.suppress(OSError):
                    found.append((path.lstat().st_mtime_ns, path))
    return [path for _, path in sorted(found)]


def is_live(path: Path) -> bool:
    try:
        fd = os.open(path, _TO_READ)
    except OSError:
        return False
    try:
        fcntl.flock(fd, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(fd)
    return False


def set_aside(path: Path) -> None:
    """Rename a file that is no ring: it is ignored from now on, and can be inspected."""
    with contextlib.suppress(OSError):
        os.rename(path, path.with_suffix(SET_ASIDE))


@contextlib.contextmanager
def left_rings(folder: Path) -> Iterator[tuple[list[LeftRing], list[Path]]]:
    """The rings that were left behind, the oldest first, and other things with the name of one.

    They are locked meanwhile. A pipe, a device, a folder, another user's file and one
    that is larger than any ring are no rings: they are never read.
    """
    held: list[int] = []
    left: list[LeftRing] = []
    strange: list[Path] = []
    try:
        for path in rings(folder):
            with contextlib.suppress(OSError):
                status = os.lstat(path)
                if not S_ISREG(status.st_mode) or status.st_uid != os.geteuid():
                    strange.append(path)
                    continue
                fd = os.open(path, _TO_READ)
                held.append(fd)
                fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
                with os.fdopen(os.dup(fd), "rb") as stream:
                    data = stream.read(LARGEST + 1)
                if len(data) > LARGEST:
                    strange.append(path)
                else:
                    left.append(LeftRing(path, data))
        # A daemon that fails at each start leaves one each time.
        for ring in left[1 : 1 - LEFT_MOST]:
            ring.remove()
            left.remove(ring)
        yield left, strange
    finally:
        for fd in held:
            os.close(fd)
