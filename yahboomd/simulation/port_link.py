"""The link behind which a port on a pseudo-terminal is found: made, turned, removed, reserved."""

from __future__ import annotations

import contextlib
import hashlib
import os
import socket
from pathlib import Path

from yahboomd.core.errors import ConfigError


def claim(link: Path) -> socket.socket:
    """Reserve a link for this process, until the socket is closed or the process ends.

    A name in Linux's abstract socket namespace needs no file, so a kill leaves nothing behind.

    Raises:
        ConfigError: Another process has reserved it.
    """
    name = hashlib.sha256(os.fsencode(link.absolute())).hexdigest()
    claimed = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        claimed.bind(f"\0yahboomd-simulate-{name}")
    except OSError as why:
        claimed.close()
        raise ConfigError(
            f"Another simulated or replayed board runs behind {link}.",
            remedy="End it, or give this one another --link.",
        ) from why
    return claimed


def point(link: Path, target: str) -> None:
    """Make a link, or turn one to a new target, in one step.

    Raises:
        ConfigError: It cannot be made.
    """
    if link.exists() and not link.is_symlink():
        raise ConfigError(
            f"{link} exists and is not a link.", remedy="Choose another name, or remove it."
        )
    beside = link.with_name(f".{link.name}.{os.getpid()}")
    try:
        beside.unlink(missing_ok=True)
        beside.symlink_to(target)
        beside.replace(link)
    except OSError as why:
        raise ConfigError(f"The link {link} cannot be made: {why.strerror or why}.") from why


def unpoint(link: Path, target: str) -> None:
    """Remove a link if it still points to ``target``."""
    with contextlib.suppress(OSError):
        if str(link.readlink()) == target:
            link.unlink()
