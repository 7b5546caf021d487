"""The e-stop's memory: a file that is there while the latch is engaged, and survives a restart.

Only the file's presence counts: anything with its name counts as engaged, with any content. So a
disk that has room for a name and not for its content is enough.
"""

from __future__ import annotations

import contextlib
import errno
import json
import logging
import os
import stat
from pathlib import Path
from urllib.parse import unquote

from yahboomd.core.daemon.folder import check_folder, prepare_folder

log = logging.getLogger(__name__)

MAX_BYTES = 4096


class LatchFile:
    """Remembers an engaged e-stop. Every call may block for as long as the disk does.

    Args:
        path: Its path; its folder is made when needed.
        port: The serial port in the configuration, empty if it is looked for. Files beside
            this one that may belong to the same board count too: see :meth:`_files`. None: the
            file stands alone.
    """

    def __init__(self, path: Path, *, port: str | None = None) -> None:
        self._path = path
        self._port = port

    def __str__(self) -> str:
        return str(self._path)

    def load(self) -> str | None:
        """The origin of the latch that is on file; ``None`` if it is not engaged."""
        folder = self._path.parent
        try:
            check_folder(folder)
            found = self._files()
        except FileNotFoundError:
            return None
        except OSError as error:
            log.warning("%s: the e-stop counts as engaged: %s", self._path, error.strerror)
            return "unknown (its folder cannot be used)"
        for path in found:
            with contextlib.suppress(FileNotFoundError):
                return _author(path)
        return None

    def engage(self, by: str) -> None:
        """Put it on file, on the disk itself.

        Raises:
            OSError: It is not on file.
        """
        prepare_folder(self._path.parent)
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
        try:
            fd = os.open(self._path, flags, 0o644)
        except FileExistsError:
            return
        try:
            os.write(fd, json.dumps({"engaged": True, "by": by}).encode()[:MAX_BYTES])
        except OSError as error:
            log.warning("%s: engaged, without the name of who engaged it: %s", self._path, error)
        finally:
            _sync(fd)
        _sync(os.open(self._path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC))

    def release(self) -> None:
        """Remove it.

        Raises:
            OSError: It cannot be removed, so the latch must stay engaged.
        """
        with contextlib.suppress(FileNotFoundError):
            for path in self._files():
                with contextlib.suppress(FileNotFoundError):
                    _remove(path)

    def _files(self) -> list[Path]:
        """This file, and those beside it that may be the same board's under another name.

        A daemon that looks for its port may find any board on USB. A port has several names, and is
        one board's in whatever namespace. Raises FileNotFoundError without a folder.
        """
        if self._port is None:
            return [self._path]
        stem, found = self._path.name.partition("@")[0], [self._path]
        for name in sorted(os.listdir(self._path.parent)):
            start, _, port = name.partition("@")
            same = start == stem or (port and self._port and start.partition(".")[0] == "estop")
            if same and name != self._path.name and _may_be(self._port, unquote(port)):
                found.append(self._path.with_name(name))
        return found


def engaged_in(folder: Path, port: str) -> Path | None:
    """The file of an engaged e-stop in a runtime folder, of any daemon that may have this port.

    Args:
        folder: The runtime folder.

    Raises:
        OSError: The folder cannot be read.
    """
    for name in sorted(os.listdir(folder)):
        start, _, other = name.partition("@")
        if start.partition(".")[0] == "estop" and _may_be(port, unquote(other)):
            return folder / name
    return None


def _may_be(one: str, other: str) -> bool:
    if not one or not other:
        return not _simulated(one or other)
    if _simulated(one) or _simulated(other):
        return one == other
    return os.path.realpath(one) == os.path.realpath(other)


def _simulated(port: str) -> bool:
    """Whether a port's name is that of a pseudo-terminal, which may be gone."""
    real = os.path.realpath(port) if port else "/dev/"
    return real.startswith("/dev/pts/") or not real.startswith("/dev/")


def _author(path: Path) -> str:
    """The origin of the latch; in words if the file names none."""
    try:
        # A FIFO must not hold up the start, and a link may lead anywhere.
        fd = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
    except FileNotFoundError:
        raise
    except OSError as error:
        log.warning("%s cannot be read (%s): the e-stop counts as engaged", path, error)
        return "unknown (its file cannot be read)"
    try:
        if not stat.S_ISREG(os.fstat(fd).st_mode):
            log.warning("%s is no regular file: the e-stop counts as engaged", path)
            return "unknown (its file is no regular file)"
        return str(json.loads(os.read(fd, MAX_BYTES))["by"])
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return "unknown (its file is damaged)"
    finally:
        os.close(fd)


def _sync(fd: int) -> None:
    try:
        # Some file systems have no fsync of a folder; the written data stays.
        with contextlib.suppress(OSError):
            os.fsync(fd)
    finally:
        os.close(fd)


def _remove(path: Path) -> None:
    mode = path.lstat().st_mode
    if stat.S_ISCHR(mode) or stat.S_ISBLK(mode):
        # Root could remove it: without /dev/null a machine is broken.
        raise OSError(errno.EINVAL, "it is a device; set estop.latch_file to another path")
    path.unlink()
