"""Links that let one phone in, once: a terminal makes them, the server uses them up.

Each link is a file in the state directory. Its name has a hash of the token, and removing it uses
the link up: of two phones with the same link one removes it. Its age is measured on the clock that
counts from the boot, which no correction of the time changes; a link of another boot is removed
when the server starts.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import secrets
import stat
from pathlib import Path
from typing import Literal, TypeAlias, TypeVar

import msgspec

from yahboomd.core.atomic_write import write_atomic
from yahboomd.core.clock import Clock
from yahboomd.core.errors import ConfigError
from yahboomd.core.model import NS_PER_S
from yahboomd.web.page_frames import Role

T = TypeVar("T")

PREFIX = "web-link-"

MINUTES = 15
"""How long a link that was not used lets somebody in."""

LIFE_NS = MINUTES * 60 * NS_PER_S

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
        keep(folder, _name(token), msgspec.json.encode(link))
    except OSError as error:
        raise ConfigError(
            f"No link can be made in {folder}: {error.strerror}.",
            remedy="If it belongs to the service: `sudo yahboomd web --show-link`. Else make room "
            "on the disk, or set XDG_STATE_HOME to a folder that this user may write to.",
        ) from error
    return token


def link_of(folder: Path, token: str, now_ns: int) -> EntryLink | Fault:
    """The link of a token, or the reason why it lets nobody in."""
    link = read_private(folder / _name(token), EntryLink)
    if link is None:
        return "unknown"
    return link if 0 <= now_ns - link.made_ns <= LIFE_NS else "old"


def use_up(folder: Path, token: str) -> bool:
    """Use the link up; returns whether it was there: of all that try, one succeeds.

    Raises:
        OSError: It cannot be removed, and lets nobody in.
    """
    try:
        (folder / _name(token)).unlink()
    except FileNotFoundError:
        return False
    return True


def forget_links(folder: Path, now_ns: int | None = None) -> int:
    """Remove the links that ended by this time, or all of them; returns their number."""
    gone = 0
    for path in folder.glob(f"{PREFIX}*"):
        link = read_private(path, EntryLink)
        if now_ns is None or link is None or not 0 <= now_ns - link.made_ns <= LIFE_NS:
            with contextlib.suppress(OSError):
                path.unlink()
                gone += 1
    return gone


def digest(secret: str) -> str:
    """A hash of a secret of 128 bits, so that reading the file gives nobody the secret."""
    return hashlib.sha256(secret.encode("utf-8", "surrogatepass")).hexdigest()


def _name(token: str) -> str:
    return f"{PREFIX}{digest(token)[:40]}"
