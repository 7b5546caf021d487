"""Replaces a file in one step: its name leads to the old or the new one, also after a power cut."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

_NOT_SUPPORTED = {errno.EINVAL, errno.ENOTSUP}


def write_atomic(
    path: Path,
    data: bytes,
    *,
    mode: int = 0o644,
    owner: tuple[int, int] | None = None,
    check: Callable[[Path], object] | None = None,
    replace: bool = True,
) -> None:
    """Write a file beside ``path``, and give it that name once its content is on the disk.

    A link with that name is replaced, not followed. If this process is killed, the file beside it
    remains: a dot, the name, a dot and eight digits.

    Args:
        mode: Its permissions.
        owner: User and group, if root writes for somebody else.
        check: Called with the file before it gets its name; what it raises ends the writing.
        replace: Whether an existing file is replaced.

    Raises:
        OSError: It cannot be written: the old one is as it was.
        FileExistsError: There is one, and it must not be replaced.
    """
    beside = path.with_name(f".{path.name}.{os.urandom(4).hex()}")
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
    fd = os.open(beside, flags, 0o600)
    try:
        with open(fd, "wb") as file:
            os.fchmod(fd, mode)
            if owner is not None:
                os.chown(fd, *owner)
            file.write(data)
            file.flush()
            # A disk may write the name before the content, and lose power between them.
            os.fsync(fd)
        if check is not None:
            check(beside)
        if replace:
            os.replace(beside, path)
        else:
            os.link(beside, path)
    finally:
        with suppress(FileNotFoundError):
            os.unlink(beside)
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Have the names in a folder on the disk.

    Raises:
        OSError: The disk fails. A file system that cannot do it is no error.
    """
    fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(fd)
    except OSError as error:
        if error.errno not in _NOT_SUPPORTED:
            raise
    finally:
        os.close(fd)
