"""A note of how a daemon opened its port, for the process that must stop the wheels after it.

``ExecStopPost=`` of the service runs ``yahboomd stop --direct`` when the daemon was killed. The
robot drives on until the first stop, and reading the configuration would take several times as long
as all other steps before it. So each daemon writes a note for each port into its runtime folder.
The standard library alone can read it.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from typing import Any, NamedTuple

from yahboomd.core.link.port_identity import Device

NAME = "port"
MAX_BYTES = 4096


class PortNote(NamedTuple):
    """A port, how it was opened, and by which daemon.

    Attributes:
        path: The device, as it was named: a link stays a link.
        device: Its identity: its name may be another's by now.
        pid: The daemon's process.
        listen: The daemon's endpoints for Zenoh.
        ended: The daemon ended in order, or its guard, and its wheels were seen to stand.
        relay: The line of the relay in the motors' supply; empty for none.
        latch: The file of the daemon's emergency stop; empty once the daemon itself ended in order.
    """

    path: str
    baudrate: int
    dtr: bool
    rts: bool
    hangup_on_close: bool
    device: Device
    pid: int = 0
    namespace: str = ""
    listen: tuple[str, ...] = ()
    ended: bool = False
    relay: str = ""
    latch: str = ""

    def options(self) -> dict[str, Any]:
        """The arguments of :func:`yahboomd.core.link.seize.seize`."""
        return dict(zip(self._fields[:6], self[:6], strict=True))


def write(note: PortNote, folder: str) -> bool:
    """Write the note; return whether it is there. Never raises: the configuration replaces it.

    Notes of this process on other ports are removed: it has one port at a time. So are those of
    daemons that are gone and had ended in order.
    """
    from urllib.parse import quote

    port = quote(note.path, safe="")[-120:]
    name = f"{NAME}{'.' if note.namespace else ''}{quote(note.namespace, safe='')[:80]}@{port}"
    try:
        for place, other in _found(folder):
            if other == note:
                return True
            own = note.pid and other.pid == note.pid
            if os.path.basename(place) != name and (own or (other.ended and not _alive(other.pid))):
                os.unlink(place)
        _put(os.path.join(folder, name), note)
    except OSError:
        return False
    return True


def end(folder: str, pid: int, *, killed: bool = False) -> None:
    """Note that a daemon has ended, or was killed, and its wheels stand. Never raises."""
    for place, note in _found(folder):
        if note.pid == pid:
            try:
                _put(place, note._replace(ended=True, latch=note.latch if killed else ""))
            except OSError:
                return


def read(folder: str) -> list[PortNote]:
    return [note for _, note in _found(folder)]


def folder_of(environ: Mapping[str, str]) -> str:
    """The runtime folder that a service manager gives; empty without one."""
    # If a unit has several, systemd separates them by colons.
    return environ.get("RUNTIME_DIRECTORY", "").split(":")[0]


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return pid > 0


def _put(place: str, note: PortNote) -> None:
    from pathlib import Path

    from yahboomd.core.atomic_write import write_atomic

    data = text_of(note).encode()
    try:
        write_atomic(Path(place), data)
    except OSError:
        # On a full disk the old note has room for this one; unchanged, it may state that the
        # wheels stand.
        fd = os.open(place, os.O_WRONLY | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
        try:
            os.ftruncate(fd, os.write(fd, data))
        finally:
            os.close(fd)


def _found(folder: str) -> list[tuple[str, PortNote]]:
    try:
        names = sorted(os.listdir(folder)) if folder else []
    except OSError:
        return []
    places = [
        os.path.join(folder, name) for name in names if name.startswith((f"{NAME}@", f"{NAME}."))
    ]
    return [(place, note) for place in places if (note := _note(place)) is not None]


def _note(place: str) -> PortNote | None:
    try:
        # A FIFO under its name must not block.
        fd = os.open(place, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
        with open(fd, "rb") as file:
            text = file.read(MAX_BYTES)
    except OSError:
        return None
    return note_of(text)


def text_of(note: PortNote | None) -> str:
    return "" if note is None else json.dumps(note._asdict())


def note_of(text: str | bytes) -> PortNote | None:
    try:
        note = PortNote(**json.loads(text))
        note = note._replace(device=Device(*note.device), listen=tuple(note.listen))
    except (ValueError, TypeError, RecursionError):
        return None
    if tuple(map(type, note[:5])) != (str, int, bool, bool, bool):
        return None
    if tuple(map(type, note.device)) != (int, str, str):
        return None
    if (type(note.pid), type(note.namespace), type(note.ended)) != (int, str, bool):
        return None
    return note if all(isinstance(each, str) for each in (note.latch, *note.listen)) else None
