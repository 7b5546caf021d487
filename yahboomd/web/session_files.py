"""The files of links and sessions in the state directory.

A link lets one phone in, once: a terminal makes it, the server uses it up. Its file's
name has a hash of the token, and removing it uses the link up: of two phones with the same link one
removes it. Its age is measured on the clock that counts from the boot, which no correction of the
time changes; a link of another boot is removed when the server starts.

A session is a file for each phone, which the server writes and a terminal may remove. Its name has
the session's number, and the time of the file is its last use.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import re
import secrets
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Literal, TypeAlias, TypeVar

import msgspec

from yahboomd.core.atomic_write import sync_folder, write_atomic
from yahboomd.core.clock import Clock
from yahboomd.core.errors import ConfigError
from yahboomd.core.model import NS_PER_S

T = TypeVar("T")

Role: TypeAlias = Literal["driver", "viewer"]

LINK_PREFIX = "web-link-"

MINUTES = 15
"""How long a link that was not used lets somebody in."""

LINK_NS = MINUTES * 60 * NS_PER_S

LARGEST_BYTES = 4096

Fault: TypeAlias = Literal["unknown", "old"]


class EntryLink(msgspec.Struct, frozen=True, kw_only=True):
    """A link that was not used yet.

    Attributes:
        made_ns: Nanoseconds since the boot of this machine.
    """

    role: Role
    made_ns: int


def since_boot_ns(clock: Clock) -> int:
    """The time since the boot, which corrections of the time do not change."""
    return clock.now_ns() + clock.suspended_ns()


def keep(folder: Path, name: str, content: bytes) -> None:
    """Write a file that only its folder's owner can read, also if root writes it.

    An existing link is replaced, not followed: the service's user can write to that folder, and
    must not make root write elsewhere.

    Raises:
        OSError: The folder cannot be written to.
    """
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    its = folder.stat()
    owner = (its.st_uid, its.st_gid) if os.geteuid() == 0 else None
    write_atomic(folder / name, content, mode=0o600, owner=owner)


def read_private(path: Path, kind: type[T]) -> T | None:
    """A file that nobody but its owner can use; None if it is missing or anything else.

    Links are not followed: root reads the folder of the service's user.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
        with os.fdopen(descriptor, "rb") as file:
            mode = os.fstat(descriptor).st_mode
            if not stat.S_ISREG(mode) or mode & 0o077:
                return None
            return msgspec.json.decode(file.read(LARGEST_BYTES), type=kind)
    except (OSError, ValueError, RecursionError):
        return None


def make_entry(folder: Path, role: Role, clock: Clock) -> str:
    """Make a link for one phone; returns its token. Older links that ended are removed.

    Raises:
        ConfigError: The folder cannot be written to.
    """
    token = secrets.token_urlsafe(16)
    now_ns = since_boot_ns(clock)
    link = EntryLink(role=role, made_ns=now_ns)
    try:
        forget_links(folder, now_ns)
        keep(folder, _link_name(token), msgspec.json.encode(link))
    except OSError as error:
        raise ConfigError(
            f"No link can be made in {folder}: {error.strerror}.",
            remedy="If it belongs to the service: `sudo yahboomd web --show-link`. Else make room "
            "on the disk, or set XDG_STATE_HOME to a folder that this user may write to.",
        ) from error
    return token


def link_of(folder: Path, token: str, now_ns: int) -> EntryLink | Fault:
    """The link of a token, or the reason why it lets nobody in."""
    link = read_private(folder / _link_name(token), EntryLink)
    if link is None:
        return "unknown"
    return link if 0 <= now_ns - link.made_ns <= LINK_NS else "old"


def use_up(folder: Path, token: str) -> bool:
    """Use the link up; returns whether it was there: of all that try, one succeeds.

    Raises:
        OSError: It cannot be removed, and lets nobody in.
    """
    try:
        (folder / _link_name(token)).unlink()
    except FileNotFoundError:
        return False
    return True


def forget_links(folder: Path, now_ns: int | None = None) -> int:
    """Remove the links that ended by this time, or all of them; returns their number."""
    gone = 0
    for path in folder.glob(f"{LINK_PREFIX}*"):
        link = read_private(path, EntryLink)
        if now_ns is None or link is None or not 0 <= now_ns - link.made_ns <= LINK_NS:
            with contextlib.suppress(OSError):
                path.unlink()
                gone += 1
    return gone


def digest(secret: str) -> str:
    """A hash of a secret of 128 bits, so that reading the file gives nobody the secret."""
    return hashlib.sha256(secret.encode("utf-8", "surrogatepass")).hexdigest()


def _link_name(token: str) -> str:
    return f"{LINK_PREFIX}{digest(token)[:40]}"


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
