"""The file of a ring: in memory that outlives the process, and locked while its daemon lives.

A ring without a lock was left behind, by a daemon that was killed or that could not save it.
The file lies where no disk is involved (a tmpfs): a page of a disk's file may have to wait until
the disk has written it, and with it the control loop.
"""

from __future__ import annotations

import contextlib
import fcntl
import mmap
import os
import secrets
import zlib
from collections.abc import Iterator
from pathlib import Path

from yahboomd.blackbox.box_file import Header, encode_header, read_box, robot_slug
from yahboomd.blackbox.records import Ended
from yahboomd.blackbox.ring import Ring

SEGMENTS = 16
SEGMENT_BYTES = 48 * 1024
"""The newest fifteen segments are always there: 720 KiB, 12 kB for each of 60 s.

The most that the boards of this house send is 6.6 kB/s, with what belongs to each record: a
four-channel board sends 169 lines of 32 bytes a second, each in a read of its own. Its commands and
their repeats are 1.9 kB/s, the commands from the bus, at most 100 a second, 3.5 kB/s.
"""

SUFFIX = ".ring"
UNFINISHED = ".ring-new"
LEFT_MOST = 4
"""So many rings that were left behind are kept for the next start, the first one and the newest."""

_IN_MEMORY = {"tmpfs", "ramfs", "rootfs"}


def ring_folder(runtime: Path, user_id: int) -> Path:
    """The folder of the rings: the runtime folder, or one in /dev/shm where that is on a disk.

    Args:
        runtime: The runtime folder, which need not be there yet.
    """
    there = next(each for each in (runtime, *runtime.parents) if each.exists())
    memory = Path("/dev/shm")  # noqa: S108 - its entries are checked before they are used
    if _file_system(there) in _IN_MEMORY or not memory.is_dir():
        return runtime
    return memory / f"yahboomd-{user_id}-{zlib.crc32(os.fsencode(runtime)):08x}"


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

    Raises:
        OSError: It cannot be made: the folder is full or read-only.
    """

    def __init__(self, folder: Path, header: Header) -> None:
        head = encode_header(header)
        size = len(head) + SEGMENTS * header.segment_bytes
        name = "-".join(filter(None, (robot_slug(header), secrets.token_hex(4))))
        self._path = folder / f"blackbox-{name}{SUFFIX}"
        unfinished = self._path.with_suffix(UNFINISHED)
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
        self._fd = os.open(unfinished, flags, 0o640)
        try:
            os.fchmod(self._fd, 0o640)
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # Here a lack of memory is an error; later it would be a signal that kills.
            os.posix_fallocate(self._fd, 0, size)
            flags = mmap.MAP_SHARED | mmap.MAP_POPULATE
            self._map = mmap.mmap(self._fd, size, flags)
            self._map[: len(head)] = head
            self._head_bytes = len(head)
            os.rename(unfinished, self._path)
        except OSError:
            os.close(self._fd)
            os.unlink(unfinished)
            raise
        self.ring = Ring(self._map, len(head), header.segment_bytes)

    def segments(self) -> bytes:
        """A copy of what is in it, without the header."""
        return self._map[self._head_bytes :]

    def close(self, *, keep: bool) -> None:
        """Close it; nothing is recorded any more.

        Args:
            keep: Leave the file for the next start.
        """
        if not keep:
            with contextlib.suppress(OSError):
                os.unlink(self._path)
        # The map stays until the process ends, with a descriptor of its own: a late record must
        # find it.
        fcntl.flock(self._fd, fcntl.LOCK_UN)
        os.close(self._fd)


class LeftRing:
    """A ring that was left behind, locked until it is saved."""

    def __init__(self, path: Path, data: bytes) -> None:
        self.path = path
        self.data = data

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why it is to be saved: its daemon was killed, unless it says otherwise."""
        for record in reversed(read_box(self.data).records):
            if isinstance(record.meaning, Ended):
                return record.meaning.reasons
        return ("killed",)

    def remove(self) -> None:
        """Remove the file."""
        with contextlib.suppress(OSError):
            os.unlink(self.path)


def rings(folder: Path) -> list[Path]:
    """Every ring in a folder, the oldest first."""
    found = []
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            if path.suffix == SUFFIX and path.name.startswith("blackbox-"):
                with contextlib.suppress(OSError):
                    found.append((path.stat().st_mtime_ns, path))
    return [path for _, path in sorted(found)]


def is_live(path: Path) -> bool:
    """Whether the daemon of a ring runs."""
    try:
        fd = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(fd, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(fd)
    return False


@contextlib.contextmanager
def left_rings(folder: Path) -> Iterator[list[LeftRing]]:
    """The rings that were left behind, the oldest first; no other daemon finds them meanwhile."""
    held: list[int] = []
    left: list[LeftRing] = []
    try:
        for path in rings(folder):
            with contextlib.suppress(OSError):
                fd = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
                held.append(fd)
                fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
                with os.fdopen(os.dup(fd), "rb") as stream:
                    left.append(LeftRing(path, stream.read()))
        # A daemon that fails at each start leaves one each time.
        for ring in left[1 : 1 - LEFT_MOST]:
            ring.remove()
            left.remove(ring)
        yield left
    finally:
        for fd in held:
            os.close(fd)
