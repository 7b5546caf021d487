"""The local half of ``yahboomd stop``: the daemons of this machine, each on a socket of its own.

It needs neither Zenoh nor asyncio nor the configuration, so it runs before they are loaded. Its
protocol is in docs/bus.md.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import socket
import struct
import time
from collections.abc import Iterable, Mapping, Sequence
from glob import escape as glob_escape
from glob import glob
from typing import Any, NamedTuple

from yahboomd.link import port_note
from yahboomd.link.port_note import PortNote
from yahboomd.program import pasteable, plain, release_command

STATUS_WITHIN_S = 0.5
ENGAGED_WITHIN_S = 1.5
STOOD_WITHIN_S = 2.5
RETRY_S = 0.02
MAX_BYTES = 65_536
STOP = b"stop by yahboomd stop\n"
"""Any request but ``status`` engages; this one names the program that asks."""

_LONGEST_PATH = 100


class Wanted(NamedTuple):
    """A choice among daemons. None and empty fields fit all.

    Attributes:
        port: The serial port.
        namespace: The robot's name.
        listen: Where the daemon listens; one of them is enough.
    """

    port: str = ""
    namespace: str | None = None
    listen: tuple[str, ...] = ()

    def fits(self, robot: Robot) -> bool:
        """Whether a daemon is meant. One that did not answer may hold the port all the same."""
        if self.port:
            return any(same_port(self.port, each) for each in robot.ports) or holds(
                robot.pid, self.port
            )
        if robot.silent:
            return self.namespace is None and not self.listen
        if self.namespace is not None and self.namespace != robot.namespace:
            return False
        return not self.listen or bool({*self.listen} & {*robot.listen})


class Robot(NamedTuple):
    """A daemon of this machine.

    Attributes:
        socket: Its socket.
        pid: Of the process that listens there; 0 where it is in another PID namespace.
        silent: It did not answer.
        namespace: The robot's name.
        ports: The serial port, as configured and as opened.
        listen: Where it listens for Zenoh.
    """

    socket: str
    pid: int
    silent: bool = False
    namespace: str = ""
    ports: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """In a sentence: ``bot1 (pid 12, /dev/ttyUSB0)``."""
        facts = ", ".join((f"pid {self.pid}", *self.ports[:1]))
        return f"{self.namespace or 'yahboomd'} ({facts})"


class Outcome(NamedTuple):
    """The result of a stop.

    Attributes:
        robot: Whose.
        words: What was done and seen, for a person.
        stood: The wheels were seen to stand.
        blind: No counts came.
    """

    robot: Robot
    words: str
    stood: bool
    blind: bool = False


class LocalStops:
    """The stops of all daemons that are meant.

    Attributes:
        silent: Those that did not answer: frozen, hung, or busy for too long.
        others: Those that are not meant, and were left alone.
        unknown: Those that did not answer and may be meant or not; left alone, too.
        answering: Those that answer.
        wanted: Which are meant.
    """

    def __init__(self) -> None:
        self.answering: list[Robot] = []
        self.wanted = Wanted()
        self.silent: list[Robot] = []
        self.others: list[Robot] = []
        self.unknown: list[Robot] = []
        self._meant: list[tuple[Robot, _Talk]] = []

    def engage(self, wanted: Wanted, found: Iterable[Robot]) -> None:
        """Stop them; returns once each that answers has engaged its emergency stop.

        The others are not awaited: they have the request, and engage as soon as they run again.
        """
        self.wanted = wanted
        for robot in found:
            if not robot.silent:
                self.answering.append(robot)
            if wanted.fits(robot):
                self._meant.append((robot, _Talk(robot.socket, STOP)))
            else:
                (self.unknown if robot.silent else self.others).append(robot)
        for _, talk in self._meant:
            talk.connect()
        answering = [talk for robot, talk in self._meant if not robot.silent]
        _converse(answering, lines=1, within_s=ENGAGED_WITHIN_S)

    def outcomes(self) -> list[Outcome]:
        """Wait until the wheels stand, for some seconds at most; how each stop went."""
        _converse([talk for _, talk in self._meant], lines=2, within_s=STOOD_WITHIN_S)
        found = []
        for robot, talk in self._meant:
            talk.close()
            if talk.lines and talk.lines[0].get("engaged") is True:
                found.append(_outcome(robot, talk.lines))
            else:
                self.silent.append(robot)
        return found


def find(environ: Mapping[str, str]) -> list[Robot]:
    """The daemons of this machine that this user may stop."""
    talks = [_Talk(path, b"status\n") for path in sockets(environ)]
    _converse(talks, lines=1, within_s=STATUS_WITHIN_S)
    found = []
    for talk in talks:
        talk.close()
        refused = any("error" in line for line in talk.lines)
        if talk.connected and not refused:
            found.append(_robot(talk))
    return found


def covered(outcome: Outcome, paths: Iterable[str]) -> bool:
    """Whether a daemon without counts has no board: another one, or this stop, holds its port."""
    return outcome.blind and any(
        same_port(port, path) for port in outcome.robot.ports for path in paths
    )


def there(robots: Sequence[Robot], command: str) -> str:
    """Name the daemons that are there instead, and how a command reaches them; empty for none."""
    sentences = []
    for robot in robots:
        words = [f"yahboomd {command}"]
        words += [f"--namespace {robot.namespace}"] if robot.namespace else []
        if command != "stop":
            words += [f"--connect {robot.listen[0]}"] if robot.listen else []
        elif robot.ports and not robot.namespace:
            words.append(f"--port {robot.ports[0]}")
        sentences.append(f"{robot.name} runs here: `{' '.join(words)}`.")
    return "\n".join(sentences)


def sockets(
    environ: Mapping[str, str], *, user_id: int | None = None, root: str = "/"
) -> list[str]:
    """The sockets of daemons: of services, of this user's own, and for root of all users'."""
    found = [glob(f"{glob_escape(each)}/stop*.sock") for each in folders(environ, user_id, root)]
    return [path for paths in found for path in sorted(paths) if _trusted(path)]


def folders(
    environ: Mapping[str, str], user_id: int | None = None, root: str = "/"
) -> tuple[str, ...]:
    """The runtime folders of daemons: of services, of this user, and for root of all users."""
    own = os.geteuid() if user_id is None else user_id
    patterns = [f"{root}run/yahboomd", f"{root}run/yahboomd-*"]
    given = environ.get("RUNTIME_DIRECTORY", "").split(":")[0]
    session = environ.get("XDG_RUNTIME_DIR")
    patterns += [given] if given else []
    patterns += [f"{session}/yahboomd"] if session else []
    patterns += [
        f"{root}run/user/{'*' if own == 0 else own}/yahboomd",
        f"{root}tmp/yahboomd-{'[0-9]*' if own == 0 else own}",
    ]
    return tuple(dict.fromkeys(path for each in patterns for path in sorted(glob(each))))


def notes(environ: Mapping[str, str], wanted: Wanted, living: Iterable[Robot]) -> list[PortNote]:
    """The notes of daemons that neither answer nor ended in order: their boards may drive on."""
    pids = {robot.pid for robot in living}
    found = []
    for folder in folders(environ):
        with contextlib.suppress(OSError):
            # The folder's owner chooses which file is opened.
            if os.stat(folder).st_uid in {0, os.geteuid()}:
                found += [each for each in port_note.read(folder) if not each.ended]
    return [
        note
        for note in found
        if note.pid not in pids
        and wanted.fits(Robot("", note.pid, False, note.namespace, (note.path,), note.listen))
    ]


def holds(pid: int, port: str) -> bool:
    """Whether a process has a port open, as far as this user may see."""
    with contextlib.suppress(OSError):
        device = os.stat(port).st_rdev
        for fd in os.listdir(f"/proc/{pid}/fd"):
            with contextlib.suppress(OSError):
                if os.stat(f"/proc/{pid}/fd/{fd}").st_rdev == device != 0:
                    return True
    return False


class _Talk:
    """One request on one socket, and the lines that come back."""

    def __init__(self, path: str, request: bytes) -> None:
        self.path = path
        self.lines: list[dict[str, Any]] = []
        self.connected = False
        self.ended = False
        self.pid = 0
        self._request = request
        self._data = b""
        self.sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)

    def connect(self) -> None:
        """Connect and ask; a full queue is tried again by the caller."""
        try:
            _connect(self.sock, self.path)
            size = struct.calcsize("iII")
            raw = self.sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, size)
            self.pid = struct.unpack("iII", raw)[0]
            self.connected = True
            self.sock.send(self._request, socket.MSG_NOSIGNAL)
        except BlockingIOError:
            return
        except BrokenPipeError:
            # Refused; the reason can be read.
            return
        except OSError:
            self.ended = True

    def read(self) -> None:
        """Receive."""
        try:
            data = self.sock.recv(MAX_BYTES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        self._data += data
        self.ended = not data or len(self._data) > MAX_BYTES
        *whole, self._data = self._data.split(b"\n")
        for line in whole:
            with contextlib.suppress(ValueError):
                facts = json.loads(line)
                if isinstance(facts, dict):
                    self.lines.append(facts)

    def close(self) -> None:
        """Close the socket."""
        self.sock.close()


def _converse(talks: Iterable[_Talk], *, lines: int, within_s: float) -> None:
    """Run all of them at once, until each has so many lines, or has ended."""
    deadline = time.monotonic() + within_s
    while True:
        open_ = [talk for talk in talks if len(talk.lines) < lines and not talk.ended]
        left = deadline - time.monotonic()
        if not open_ or left <= 0:
            return
        for talk in open_:
            if not talk.connected:
                talk.connect()
        waiting = [talk for talk in open_ if talk.connected]
        wait_s = left if len(waiting) == len(open_) else min(left, RETRY_S)
        poll = select.poll()
        for talk in waiting:
            poll.register(talk.sock, select.POLLIN)
        ready = {fd for fd, _ in poll.poll(1000 * wait_s)}
        for talk in waiting:
            if talk.sock.fileno() in ready:
                talk.read()


def _connect(sock: socket.socket, path: str) -> None:
    if len(os.fsencode(path)) <= _LONGEST_PATH:
        sock.connect(path)
        return
    folder, name = os.path.split(path)
    fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        sock.connect(f"/proc/self/fd/{fd}/{name}")
    finally:
        os.close(fd)


def _trusted(path: str) -> bool:
    """Whether no stranger made the folder: one below /tmp has to be its user's own."""
    folder = os.path.dirname(path)
    try:
        if not os.stat(os.path.dirname(folder)).st_mode & 0o002:
            return True
        status = os.lstat(folder)
    except OSError:
        return False
    named = folder.rpartition("-")[2]
    return status.st_uid in {0, os.geteuid()} or named == str(status.st_uid)


def _robot(talk: _Talk) -> Robot:
    facts = talk.lines[0] if talk.lines else {}
    if facts.get("daemon") != "yahboomd":
        return Robot(talk.path, talk.pid, silent=True)
    return Robot(
        talk.path,
        talk.pid,
        namespace=str(facts.get("namespace", "")),
        ports=_texts(facts.get("ports")),
        listen=_texts(facts.get("listen")),
    )


def _texts(value: object) -> tuple[str, ...]:
    return tuple(map(str, value)) if isinstance(value, list) else ()


def same_port(one: str, other: str) -> bool:
    """Whether two paths lead to one device."""
    return os.path.realpath(one) == os.path.realpath(other)


def _outcome(robot: Robot, lines: Sequence[dict[str, Any]]) -> Outcome:
    words = pasteable(plain(str(lines[0].get("message", ""))))
    seen = lines[1] if len(lines) > 1 else {}
    if seen.get("stood") is True:
        again = release_command(robot.namespace, robot.listen)
        words += pasteable(f" The wheels stand. To drive again: {again}")
        return Outcome(robot, words, stood=True)
    fastest = seen.get("fastest_m_s")
    if isinstance(fastest, int | float):
        words += f" The wheels still turn, at {fastest:.2f} m/s: switch their supply off."
        return Outcome(robot, words, stood=False)
    missing = next((port for port in robot.ports if not os.path.exists(port)), "")
    words = words.removesuffix(".")
    if missing:
        words += (
            f", but {missing} is gone, so no stop reached the board. The wheels may still turn: "
            "switch the motor supply off."
        )
    else:
        words += (
            ", but the daemon receives no counts from the board, so it cannot see whether the "
            "wheels stand. Look at them: where they turn, switch the motor supply off."
        )
    return Outcome(robot, words, stood=False, blind=True)
