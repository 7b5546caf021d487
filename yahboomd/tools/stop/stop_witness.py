"""Decides whether to believe a process that reports that the wheels at a port stand.

Any user may listen on a socket and name any port. The kernel names the process and its user.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Sequence
from stat import S_ISDIR

from yahboomd.core.link.port_identity import is_pseudo


def believed(pid: int, uid: int | None, socket: str, ports: Sequence[str]) -> bool:
    """Whether to believe a process that answers.

    Believed are root, the caller, the owner of a folder that only root can have made, and a process
    that is seen to hold every port that it names, if only root can redirect those names.

    Args:
        pid: The process; 0 if it is in another PID namespace.
        uid: Its user; None if it is not known.
        socket: The socket on which it answers.
        ports: The ports that it names.
    """
    if uid is None:
        return False
    if uid in {0, os.geteuid()} or made_by_root(os.path.dirname(socket), uid):
        return True
    # The process id may belong to another process by now, and a link may lead elsewhere.
    return (
        bool(ports)
        and _user_of(pid) == uid
        and all(settled(port) == port and holds(pid, port) for port in ports)
    )


def settled(port: str) -> str:
    """The place to which a name leads, if only root can change that place; else empty."""
    place = folder = os.path.realpath(port)
    # From the top, because the owner of a folder can replace everything below it.
    above = [folder := os.path.dirname(folder) for _ in range(place.count("/"))]
    try:
        for folder in reversed(above):
            status = os.lstat(folder)
            if not S_ISDIR(status.st_mode) or status.st_uid != 0 or status.st_mode & 0o022:
                return ""
    except OSError:
        return ""
    return place


def made_by_root(folder: str, owner: int) -> bool:
    """Whether only root can have made this folder, and given it to this owner."""
    try:
        folder = os.path.realpath(folder, strict=True)
        if os.stat(folder).st_uid != owner:
            return False
        while folder != (above := os.path.dirname(folder)):
            status = os.stat(folder := above)
            if status.st_uid != 0 or status.st_mode & 0o022:
                return False
    except OSError:
        return False
    return True


def holds(pid: int, port: str) -> bool:
    """Whether a process is seen to have a port open."""
    with contextlib.suppress(OSError):
        device = os.stat(port)
        for fd in os.listdir(f"/proc/{pid}/fd"):
            with contextlib.suppress(OSError):
                found = os.stat(f"/proc/{pid}/fd/{fd}")
                if found.st_rdev == device.st_rdev != 0 and (
                    # Any user can have pseudo-terminals with the same numbers.
                    os.path.samestat(found, device) or not is_pseudo(device.st_rdev)
                ):
                    return True
    return False


def _user_of(pid: int) -> int | None:
    """The effective user of a process; None if there is no such process."""
    with contextlib.suppress(OSError), open(f"/proc/{pid}/status", "rb") as file:
        return next((int(line.split()[2]) for line in file if line.startswith(b"Uid:")), None)
    return None
