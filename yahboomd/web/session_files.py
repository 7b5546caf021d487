"""The files of sessions: one for each phone, which the server writes and a terminal may remove.

The name has the session's number, and the time of the file is its last use.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
from collections.abc import Iterator
from pathlib import Path

import msgspec

from yahboomd.core.atomic_write import sync_folder
from yahboomd.web.entry_tokens import keep, read_private, use_up
from yahboomd.web.page_frames import Role

PREFIX = "web-session-"

_NAME = re.compile(rf"{PREFIX}[0-9a-f]{{6}}")
_KEY = re.compile(r"[0-9a-f]{64}")


class StoredSession(msgspec.Struct, frozen=True, kw_only=True):
    """A session as its file has it.

    Attributes:
        key: A hash of the secret in the cookie.
        made_s: Unix seconds.
    """

    role: Role
    name: str
    key: str
    made_s: int


def stored_sessions(folder: Path) -> Iterator[tuple[str, StoredSession, int]]:
    """Each session in the state directory, with the Unix nanoseconds of its last use."""
    for path in sorted(folder.glob(f"{PREFIX}*")):
        if (found := read_stored(path)) is not None:
            yield path.name.removeprefix(PREFIX), *found


def stored_numbers(folder: Path) -> list[str]:
    """The number of each session's file, also of one that cannot be read: it may be in use."""
    found = (path for path in folder.glob(f"{PREFIX}*") if _NAME.fullmatch(path.name))
    return [path.name.removeprefix(PREFIX) for path in found if path.is_symlink() or path.is_file()]


def end_stored(folder: Path, number: str) -> bool:
    """Remove a session's file, also for the time after a power cut; returns whether it was there.

    Raises:
        OSError: It cannot be removed.
    """
    try:
        with _alone(folder):
            (folder / f"{PREFIX}{number}").unlink()
            sync_folder(folder)
    except FileNotFoundError:
        return False
    return True


def read_stored(path: Path) -> tuple[StoredSession, int] | None:
    """A session and its last use; None for a file that is no session, or that others can read."""
    stored = read_private(path, StoredSession) if _NAME.fullmatch(path.name) else None
    if stored is not None and not _KEY.fullmatch(stored.key):
        return None
    try:
        return None if stored is None else (stored, path.lstat().st_mtime_ns)
    except OSError:
        return None


def touch(path: Path, wall_ns: int) -> None:
    """Renew its last use; never to an earlier one: before NTP a clock may be years behind."""
    with contextlib.suppress(OSError):
        used_ns = max(wall_ns, path.stat().st_mtime_ns)
        os.utime(path, ns=(used_ns, used_ns))


def claim(folder: Path, token: str, number: str, stored: StoredSession, wall_ns: int) -> bool:
    """Store a session, then use up its link; returns whether the link was still there.

    In this order, because a full disk must cost nobody a link.

    Raises:
        OSError: The session cannot be stored, or the link not be used up: nobody gets in.
    """
    path = folder / f"{PREFIX}{number}"
    keep(folder, path.name, msgspec.json.encode(stored))
    try:
        os.utime(path, ns=(wall_ns, wall_ns))
        won = use_up(folder, token)
    except OSError:
        end_stored(folder, number)
        raise
    if not won:
        end_stored(folder, number)
    return won


def replace(folder: Path, number: str, stored: StoredSession) -> None:
    """Write a session anew, unless a terminal ended it.

    Raises:
        OSError: It was ended, or cannot be stored and stays as it is.
    """
    path = folder / f"{PREFIX}{number}"
    with _alone(folder):
        path.stat()
        keep(folder, path.name, msgspec.json.encode(stored))


@contextlib.contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """No other process ends or replaces a session: one that was ended must not come back."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)
