"""Finds black boxes on this machine: saved ones, and the rings of daemons, alive or killed."""

from __future__ import annotations

import contextlib
import os
import stat
from collections.abc import Mapping
from glob import glob
from pathlib import Path
from typing import NamedTuple

from yahboomd.blackbox.box_file import (
    INFLATED_MOST,
    Box,
    Header,
    NotABox,
    read_box,
    read_header,
    settings_of,
)
from yahboomd.blackbox.ring_file import is_live, ring_folder, rings
from yahboomd.blackbox.saved_boxes import saved_boxes
from yahboomd.core.errors import ConfigError
from yahboomd.core.program import plain
from yahboomd.tools.blackbox.box_story import last_stop, wall_clock
from yahboomd.tools.stop.stop_local import folders

SERVICES = "/var/lib/yahboomd*/blackbox"


class BoxRobot(NamedTuple):
    """The robot of a black box, by the configuration in it.

    Attributes:
        listen: The endpoints at which its daemon listened.
        connect: The routers that it joined.
    """

    namespace: str = ""
    port: str = ""
    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()

    @property
    def key(self) -> tuple[str, ...]:
        """Identifies a robot by namespace and port, because its endpoints may change."""
        return (self.namespace, self.port) if self.namespace or self.port else self.listen

    @property
    def words(self) -> str:
        """``robot bot1 on /dev/ttyUSB0``."""
        name = f"robot {self.namespace}" if self.namespace else "the robot without a namespace"
        return plain(f"{name}{f' on {self.port}' if self.port else ''}")

    @property
    def option(self) -> str:
        """The shell option that names it: the namespace, or else its endpoint or port."""
        if self.namespace:
            return plain(f"--namespace {self.namespace}")
        return plain(f"--connect {self.listen[0]}" if self.listen else f"--port {self.port}")


class BoxQuery(NamedTuple):
    """The robot that the options of a command describe.

    Attributes:
        namespace: None for any.
        endpoints: The endpoints that reach its daemon; empty for any.
        port: Empty for any.
        named: Whether options or the configuration name a robot. If not, it is the robot that
            commands reach without options.
    """

    namespace: str | None
    endpoints: tuple[str, ...]
    port: str
    named: bool

    def fits(self, robot: BoxRobot | None) -> bool:
        """Whether a robot is this one, or may be."""
        if robot is None:
            return not self.named
        if self.namespace is not None and robot.namespace != self.namespace:
            return False
        if self.port and robot.port and robot.port != self.port:
            return False
        places = robot.listen + robot.connect
        if not self.endpoints or not places:
            return True
        return any(_same_place(own, given) for own in places for given in self.endpoints)


def _same_place(own: str, given: str) -> bool:
    """Whether two endpoints are the same, or the first listens on every interface."""
    if own == given:
        return True
    protocol, _, port = own.rpartition(":")
    return protocol.endswith(("/0.0.0.0", "/[::]")) and given.rpartition(":")[2] == port


def robot_of(header: Header) -> BoxRobot:
    """The robot of a box."""
    zenoh, serial = settings_of(header, "zenoh"), settings_of(header, "serial")

    def endpoints(key: str) -> tuple[str, ...]:
        found = zenoh.get(key)
        return tuple(map(str, found)) if isinstance(found, list | tuple) else ()

    return BoxRobot(
        namespace=str(zenoh.get("namespace", "")),
        port=str(serial.get("port", "")),
        listen=endpoints("listen"),
        connect=endpoints("connect"),
    )


class Found(NamedTuple):
    """A black box on this machine.

    Attributes:
        name: The name for people: the number of a saved box, or the name of a ring.
        kind: ``saved``; ``running`` for the ring of a running daemon; ``left`` for the ring of a
            daemon that has ended and that is not saved yet.
        written_ns: When it was written last; Unix nanoseconds.
        robot: None if the file cannot be read.
    """

    path: Path
    name: str
    kind: str
    written_ns: int
    size: int
    robot: BoxRobot | None = None


class Places(NamedTuple):
    """The folders that may hold boxes.

    Attributes:
        denied: Those of them that this user may not read.
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
        tuple(dict.fromkeys([*runtime, *(each for each in beside if each is not None)])),
        tuple(dict.fromkeys(denied)),
    )


def boxes(where: Places) -> list[Found]:
    """Every box that can be read, the oldest first."""
    found = [
        Found(box.path, str(box.number), "saved", box.written_ns, box.size, _robot(box.path))
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
                # Writing to mapped memory does not change the file's time.
                last_ns = box.records[-1].at_ns if box.records else box.header.started_ns
                at_ns, robot = wall_clock(box)(last_ns), robot_of(box.header)
                found.append(Found(path, name, kind, at_ns, len(data), robot))
    return sorted(found, key=lambda each: (each.kind == "running", each.written_ns))


def box_bytes(path: Path) -> bytes:
    """The bytes of a ring or a saved box.

    Raises:
        OSError: The file cannot be read.
        NotABox: It is larger than any box.
    """
    # A pipe without a writer would be waited for.
    with os.fdopen(os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK), "rb") as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise NotABox("This is no black box of yahboomd, and no file.")
        data = file.read(INFLATED_MOST + 1)
    if len(data) > INFLATED_MOST:
        raise NotABox("This is no black box of yahboomd: it is larger than any.")
    return data


def _robot(path: Path) -> BoxRobot | None:
    with contextlib.suppress(OSError, NotABox):
        return robot_of(read_header(box_bytes(path)))
    return None


def of_robot(found: list[Found], wanted: BoxQuery) -> list[Found]:
    """The boxes of the wanted robot.

    If no option names a robot, it is the only one, or the one that commands reach without options.

    Raises:
        ConfigError: There are several, and no option names one.
    """
    pool = [each for each in found if wanted.fits(each.robot)] if wanted.named else found
    if not pool:
        return []
    newest = _newest_stop(pool)
    robots = {
        each.robot.key: each.robot
        for each in pool
        if each.robot is not None and (each.kind == "running" or each == newest)
    }
    if len(robots) > 1:
        usual = [each for each in robots.values() if not wanted.named and wanted.fits(each)]
        if len(usual) != 1:
            listed = "; ".join(f"`{each.option}`: {each.words}" for each in robots.values())
            raise ConfigError(
                "Several robots have black boxes on this machine.", remedy=f"Name one. {listed}."
            )
        robots = {usual[0].key: usual[0]}
    return [each for each in pool if each.robot is None or each.robot.key in robots]


def choose(found: list[Found], wanted: str | None, robot: BoxQuery | None = None) -> Path:
    """The box that a person names by file, number or ring; by default that of the newest stop.

    Args:
        wanted: The person's name for the box.
        robot: The robot that the options describe.

    Raises:
        ConfigError: No box fits, or several do.
    """
    if wanted is None:
        own = found if robot is None else of_robot(found, robot)
        if not own:
            here = "of this robot " if found else ""
            raise ConfigError(
                f"There is no black box {here}on this machine.",
                remedy="A daemon saves one when the robot stops for a reason; "
                "`yahboomd blackbox save` saves one now.",
            )
        return _newest_stop(own).path
    path = Path(wanted)
    if path.is_file():
        return path
    name = wanted.lstrip("0") or wanted
    fitting = [each for each in found if each.name in (wanted, name)]
    if robot is not None and len(fitting) > 1:
        # Services of one machine count their boxes from 1 each.
        fitting = [each for each in fitting if robot.fits(each.robot)] or fitting
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
