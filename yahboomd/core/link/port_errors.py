"""A port that cannot be opened, or goes away: the error for it, with a remedy."""

from __future__ import annotations

import contextlib
import errno
import os

from yahboomd.core.errors import LinkError, PortBusy, PortDenied, PortLost, PortMissing

GUARD_NAME = "yahboomd-guard"


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
    if code == errno.ENOTTY or "Inappropriate ioctl" in words:
        return LinkError(
            f"{path}: this is no serial port.",
            remedy="`yahboomd probe --list` shows the ports that there are.",
        )
    return LinkError(
        f"{path}: the port cannot be used: {words}.",
        remedy="Is the path right? `yahboomd probe --list` names the serial ports.",
    )


def holders(path: str) -> tuple[str, ...]:
    """The processes, as ``name (pid N)``, that have the port open, as far as we may see.

    A guard beside its owner is left out: it ends with the owner's port.
    """
    try:
        device = os.stat(path).st_rdev
    except OSError:
        return ()
    found: dict[str, str] = {}
    for entry in os.listdir("/proc"):
        if not entry.isdigit() or int(entry) == os.getpid():
            continue
        with contextlib.suppress(OSError):
            for fd in os.listdir(f"/proc/{entry}/fd"):
                with contextlib.suppress(OSError):
                    if os.stat(f"/proc/{entry}/fd/{fd}").st_rdev == device != 0:
                        with open(f"/proc/{entry}/stat", encoding="utf-8") as stat:
                            found[entry] = stat.read()
                        break
    owners = {*found, str(os.getpid())}
    names = []
    for pid, status in found.items():
        # The name stands in brackets, and may contain brackets itself.
        name, _, rest = status.partition("(")[2].rpartition(")")
        if name != GUARD_NAME or rest.split()[1] not in owners:
            names.append(f"{name} (pid {pid})")
    return tuple(names)


def lost(path: str, error: Exception | None) -> PortLost:
    words = "" if error is None else f" ({error})"
    return PortLost(
        f"{path}: the port went away{words}.",
        remedy="The wheels hold their last command until the board is reached again: check the "
        "cable, and feed the motors separately, not through USB.",
    )
