"""How the daemon opened its port, noted for whoever must stop the wheels after it.

``ExecStopPost=`` of the service runs ``yahboomd stop --direct`` when the daemon was killed. Every
millisecond until the first stop is distance, and reading the configuration would take several
times as long as all else before it. So the daemon leaves a note in ``$RUNTIME_DIRECTORY``, which
is read with nothing but what Python has at hand. Without a service manager there is no note.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from typing import NamedTuple

NAME = "port"


class PortNote(NamedTuple):
    """What :func:`yahboomd.link.seize.seize` takes.

    Attributes:
        path: The device, as it was named: a link stays a link.
        baudrate: Bits per second.
        dtr: State of DTR.
        rts: State of RTS.
        hangup_on_close: Whether closing drops DTR.
    """

    path: str
    baudrate: int
    dtr: bool
    rts: bool
    hangup_on_close: bool


def write(note: PortNote, environ: Mapping[str, str]) -> bool:
    """Leave the note; whether it is there now. Never raises: it only saves time."""
    place = _place(environ)
    if place is None:
        return False
    if read(environ) == note:
        return True
    beside = f"{place}.new"
    try:
        with open(beside, "w", encoding="utf-8") as file:
            json.dump(note._asdict(), file)
        os.replace(beside, place)
    except OSError:
        # Then the configuration is read, as it would be without this file.
        return False
    return True


def read(environ: Mapping[str, str]) -> PortNote | None:
    """The note, if there is one that can be used."""
    place = _place(environ)
    if place is None:
        return None
    try:
        with open(place, encoding="utf-8") as file:
            note = PortNote(**json.load(file))
    except (OSError, ValueError, TypeError):
        return None
    return note if tuple(map(type, note)) == (str, int, bool, bool, bool) else None


def _place(environ: Mapping[str, str]) -> str | None:
    # Where a unit has several, systemd separates them by colons.
    folder = environ.get("RUNTIME_DIRECTORY", "").split(":")[0]
    return os.path.join(folder, NAME) if folder else None
