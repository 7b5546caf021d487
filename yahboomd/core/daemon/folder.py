"""The folder for files that others must not remove: the e-stop's memory and the local socket."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path


def prepare_folder(folder: Path) -> None:
    """Make the folder if it is missing, and check that no other user can remove files from it.

    A folder with a predictable name in ``/tmp`` can be created first by any user.

    Raises:
        OSError: It cannot be made, or another user controls it.
    """
    folder.mkdir(mode=0o750, parents=True, exist_ok=True)
    check_folder(folder)


def check_folder(folder: Path) -> None:
    """Check that no other user can remove files from the folder.

    Raises:
        OSError: Another user controls it, or it is not there.
    """
    own = os.geteuid()
    status = os.lstat(folder)
    if os.stat(folder.parent).st_mode & stat.S_IWOTH:
        # Every user could have made this entry.
        if not stat.S_ISDIR(status.st_mode):
            raise _refused(folder, "is no folder but a link or a file")
        if status.st_uid == own and status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            os.chmod(folder, 0o700)
    status = os.stat(folder)
    if status.st_uid not in {0, own}:
        # Its owner can remove every file in it, of any user.
        raise _refused(folder, f"belongs to the user {status.st_uid}")
    mode = status.st_mode
    if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
        raise _refused(folder, "lets every user remove files")


def _refused(folder: Path, why: str) -> PermissionError:
    return PermissionError(
        errno.EPERM,
        f"{folder} {why}, so another user could remove the file. Name a file in a folder of your "
        'own: estop.latch_file = "/home/NAME/yahboomd/estop"',
    )
