"""Finds black boxes on this machine: saved ones, and the rings of daemons, alive or killed."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping
from glob import glob
from pathlib import Path
from typing import NamedTuple

from yahboomd.blackbox.box_file import Box, NotABox, read_box
from yahboomd.blackbox.ring_file import is_live, ring_folder, rings
from yahboomd.blackbox.saved_boxes import box_bytes, saved_boxes
from yahboomd.cli.blackbox.box_story import last_stop, wall_clock
from yahboomd.cli.stop.stop_local import folders
from yahboomd.errors import ConfigError

SERVICES = "/var/lib/yahboomd*/blackbox"


class Found(NamedTuple):
    """A black box on this machine.

    Attributes:
        name: What a person calls it by: its number, or the name of the ring.
        kind: ``saved``; ``running`` for the ring of a daemon that runs, ``left`` for one that
            ended and whose ring is not saved yet.
        written_ns: When it was written last; Unix nanoseconds.
    """

    path: Path
    name: str
    kind: str
    written_ns: int
    size: int


class Places(NamedTuple):
    """Where there may be boxes.

    Attributes:
        denied: Of these, those that this user may not read.
    """

    saved: tuple[Path, ...]
    rings: tuple[Path, ...]
    denied: tuple[Path, ...]


def places(environ: Mapping[str, str], own: Path | None) -> Places:
    """The folders of services, of this user, and of the configuration.

    Args:
        own: The folder of saved boxes by the configuration.
    """
    saved = ([] if own is None else [own]) + sorted(map(Path, glob(SERVICES)))
    runtime = [Path(folder) for folder in folders(environ)]
    if given := environ.get("RUNTIME_DIRECTORY", "").split(":")[0]:
        runtime.append(Path(given))
    beside = [ring_folder(folder, os.getuid()) for folder in runtime]
    states = sorted(map(Path, glob("/var/lib/yahboomd*")))
    every = [*saved, *runtime, *states]
    denied = [folder for folder in every if folder.is_dir() and not os.access(folder, os.R_OK)]
    return Places(
        tuple(dict.fromkeys(saved)),
        tuple(dict.fromkeys([*runtime, *beside])),
        tuple(dict.fromkeys(denied)),
    )


def boxes(where: Places) -> list[Found]:
    """Every box that can be read, the oldest first."""
    found = [
        Found(box.path, str(box.number), "saved", box.written_ns, box.size)
        for folder in where.saved
        if folder not in where.denied and os.access(folder, os.R_OK)
        for box in saved_boxes(folder)
    ]
    for folder in where.rings:
        for path in rings(folder):
            name = path.stem.removeprefix("blackbox-")
            kind = "running" if is_live(path) else "left"
            with contextlib.suppress(OSError, NotABox):
                data = box_bytes(path)
                box = read_box(data)
                # What is written to memory leaves no time with the file.
                last_ns = box.records[-1].at_ns if box.records else box.header.started_ns
                found.append(Found(path, name, kind, wall_clock(box)(last_ns), len(data)))
    return sorted(found, key=lambda each: (each.kind == "running", each.written_ns))


def choose(found: list[Found], wanted: str | None) -> Path:
    """The box that a person means: a file, a number, a ring's name; without any the newest stop.

    Raises:
        ConfigError: There is none, or several.
    """
    if wanted is None:
        if not found:
            raise ConfigError(
                "There is no black box on this machine.",
                remedy="A daemon saves one when the robot stops for a reason; "
                "`yahboomd blackbox save` saves one now.",
            )
        return _newest_stop(found).path
    path = Path(wanted)
    if path.is_file():
        return path
    name = wanted.lstrip("0") or wanted
    fitting = [each for each in found if each.name in (wanted, name)]
    if len(fitting) == 1:
        return fitting[0].path
    if fitting:
        files = ", ".join(str(each.path) for each in fitting)
        raise ConfigError(
            f"Several black boxes have the number {wanted}.", remedy=f"Name one: {files}"
        )
    raise ConfigError(
        f"There is no black box {wanted}: no such file, and no such number.",
        remedy="`yahboomd blackbox` lists them.",
    )


def _newest_stop(found: list[Found]) -> Found:
    """The newest that is saved, unless the robot of a daemon that runs has stopped since then."""
    saved = [each for each in found if each.kind != "running"]
    newest, at_ns = (saved[-1], saved[-1].written_ns) if saved else (found[-1], 0)
    for each in found:
        with contextlib.suppress(ConfigError):
            box = load(each.path) if each.kind == "running" else None
            stop = None if box is None else last_stop(box.records)
            if box is not None and stop and (stop_ns := wall_clock(box)(stop.at_ns)) > at_ns:
                newest, at_ns = each, stop_ns
    return newest


def load(path: Path) -> Box:
    """Read a box.

    Raises:
        ConfigError: The file cannot be read, or is no black box.
    """
    try:
        return read_box(box_bytes(path))
    except OSError as error:
        raise ConfigError(f"{path} cannot be read: {error.strerror}.", remedy=REMEDY) from error
    except NotABox as error:
        raise ConfigError(f"{path}: {error.message}", remedy=error.remedy) from error


REMEDY = "Members of the group yahboomd may read it: sudo usermod -aG yahboomd $USER, then log in."
