"""Takes a board that went away while its wheels may turn, as soon as it is back, with a stop.

It looks for the device, not for its name, which another device may get. If a yahboomd program has
the port by then, the port is left alone, because that program begins with a stop. This module needs
only the standard library, so that a process that outlives the driving one can use it.
"""

from __future__ import annotations

import contextlib
import errno
import os

from yahboomd.core.link.port_identity import find, identify, is_pseudo
from yahboomd.core.link.port_note import PortNote
from yahboomd.core.link.seize import Seized, seize

LOOK_S = 0.1
"""The period at which the device is looked for."""

_HELD = (errno.EBUSY, errno.EAGAIN)


_OPENING = frozenset({"run", "stop", "setup", "tune", "probe"})


class TakenByOurs(Exception):
    """Another process of yahboomd has the port; it stops the wheels when it begins."""

    def __init__(self, path: str, pid: int) -> None:
        super().__init__(f"yahboomd (pid {pid}) has {path}")


def seize_again(note: PortNote) -> Seized | None:
    """Take the lost device, which sends the first stop; None if it cannot be had now.

    Args:
        note: The device and how its port was opened.

    Raises:
        TakenByOurs: Another process of yahboomd has it.
    """
    path = _path_of(note)
    if path is None:
        return None
    try:
        device = identify(os.stat(path))
        return seize(**note._replace(path=path, device=device).options(), patience_s=0.0)
    except OSError as error:
        # Gone again; or only root's until udev has set its group; or held by a process.
        if error.errno in _HELD:
            for pid in _ours(device.number):
                raise TakenByOurs(path, pid) from None
        return None


def arguments(pid: int, *, proc: str = "/proc") -> list[str]:
    """The command line of a process; empty if it cannot be read."""
    try:
        with open(f"{proc}/{pid}/cmdline", "rb") as file:
            return os.fsdecode(file.read()).split("\0")[:-1]
    except OSError:
        return []


def is_yahboomd(pid: int, *, proc: str = "/proc") -> bool:
    """Whether a process runs yahboomd, by its own command or as ``python -m``."""
    return "yahboomd" in (os.path.basename(word) for word in arguments(pid, proc=proc)[:3])


def drives(pid: int, *, proc: str = "/proc") -> bool:
    """Whether a process runs a command of yahboomd that opens a board's port."""
    return is_yahboomd(pid, proc=proc) and not _OPENING.isdisjoint(arguments(pid, proc=proc)[:4])


def _path_of(note: PortNote) -> str | None:
    device = note.device
    if device is None:
        return None
    found = find(device)
    if found is None and is_pseudo(device.number) and os.path.islink(note.path):
        # A pseudo-terminal does not come back: its owner points the link to the next one.
        with contextlib.suppress(OSError):
            return note.path if is_pseudo(os.stat(note.path).st_rdev) else None
    return found


def _ours(device: int) -> list[int]:
    """The yahboomd processes that have a device, or may have it: some belong to other users."""
    found = []
    for pid in (int(name) for name in os.listdir("/proc") if name.isdigit()):
        if pid == os.getpid() or not is_yahboomd(pid):
            continue
        try:
            for fd in os.listdir(f"/proc/{pid}/fd"):
                with contextlib.suppress(FileNotFoundError):
                    if os.stat(f"/proc/{pid}/fd/{fd}").st_rdev == device:
                        found.append(pid)
        except PermissionError:
            found += [pid] if drives(pid) else []
        except OSError:
            continue
    return found
