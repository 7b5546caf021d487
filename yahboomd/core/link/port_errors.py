"""A port that cannot be opened, or goes away: the error for it, with a remedy."""

from __future__ import annotations

import contextlib
import errno
import os
from pathlib import Path

from yahboomd.core.errors import LinkError, PortBusy, PortDenied, PortLost, PortMissing
from yahboomd.core.link.port_identity import is_pseudo
from yahboomd.core.processes import name_and_parent, processes_with

GUARD_NAME = "yahboomd-guard"

CONSOLES = Path("/sys/class/tty/console/active")


def takes_no_output(path: str) -> PortLost:
    return PortLost(
        f"{path}: the port takes no output.",
        remedy="It is opened again, which drops what it holds back. If that repeats, look at the "
        "USB cable, the hub and the adapter.",
    )


def explained(path: str, error: Exception) -> LinkError:
    code = getattr(error, "errno", None)
    words = str(error)
    if code in {errno.ENOENT, errno.ENODEV, errno.ENXIO, errno.EIO}:
        return PortMissing(
            f"{path}: there is no such port.",
            remedy="Is the board plugged in and powered? `yahboomd probe --list` lists the ports "
            "it sees.",
        )
    if code in {errno.EACCES, errno.EPERM}:
        return PortDenied(
            f"{path}: this user may not open the port.",
            remedy="Add the user to the group that owns it (sudo usermod -aG dialout $USER) and "
            "log in again.",
        )
    if code in {errno.EBUSY, errno.EAGAIN}:
        who = holders(path)
        named = f" by {', '.join(who)}" if who else ""
        return PortBusy(
            f"{path}: the port is held{named}.",
            remedy="One process owns the board: stop the other one, or use its bus instead.",
        )
    is_other = code == errno.ENOTTY or "Inappropriate ioctl" in words
    fault = "this is no serial port" if is_other else f"the port cannot be used: {words}"
    return LinkError(
        f"{path}: {fault}.", remedy="`yahboomd probe --list` shows the serial ports that there are."
    )


def holders(path: str) -> tuple[str, ...]:
    """The processes, as ``name (pid N)``, that have the port open, as far as we may see.

    A guard beside its owner is left out: it ends with the owner's port.
    """
    try:
        port = os.stat(path)
    except OSError:
        return ()
    # A container has pseudo-terminals of its own with the same numbers.
    place = port.st_dev if is_pseudo(port.st_rdev) else None
    found = processes_with(
        lambda file: file.st_rdev == port.st_rdev != 0 and place in {None, file.st_dev}
    )
    own, names = os.getpid(), []
    for pid, status in found.items():
        name, parent = name_and_parent(status)
        if pid != own and (name != GUARD_NAME or parent not in {*found, own}):
            names.append(f"{name} (pid {pid})")
    return tuple(names)


def other_readers(path: str) -> str:
    """A sentence about others that have our open port open, with the remedy; empty without any.

    A service may not see the processes of other users, but it sees whether its port is a console.
    """
    tty = os.path.basename(os.path.realpath(path))
    who, remedy = ", ".join(holders(path)), "Two readers share the board's answers: end the other."
    with contextlib.suppress(OSError):
        if tty in CONSOLES.read_text(encoding="utf-8").split():
            who = who or "the system's console"
            remedy = (
                f"The kernel's command line makes it a console: take console={tty} away (on a "
                "Raspberry Pi console=serial0) and restart; docs/install.md has the commands."
            )
    return f"{path} is also open in {who}. {remedy}" if who else ""


def lost(path: str, error: Exception | None) -> PortLost:
    words = "" if error is None else f" ({error})"
    return PortLost(
        f"{path}: the port went away{words}.",
        remedy="The wheels hold their last command until the board is reached again: check the "
        "cable, and feed the motors separately, not through USB.",
    )
