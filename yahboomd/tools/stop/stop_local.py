"""The local half of ``yahboomd stop``: asks the guards of this machine at their sockets.

It needs neither Zenoh nor asyncio nor the configuration, so it runs before they are loaded.
docs/bus.md describes the protocol.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import struct
import threading
import time
from collections.abc import Iterable, Mapping, Sequence
from glob import escape as glob_escape
from glob import glob
from typing import Any, NamedTuple

from yahboomd.core.link import port_note
from yahboomd.core.link.port_note import PortNote
from yahboomd.core.program import pasteable, plain, release_command
from yahboomd.tools.stop.local_socket import connect
from yahboomd.tools.stop.stop_witness import believed, holds, settled

STATUS_WITHIN_S = 0.5
ENGAGED_WITHIN_S = 1.5
STOOD_WITHIN_S = 2.5
ENDED_WITHIN_S = 10.0
"""The time for ``setup`` and ``tune`` to stop the wheels, see them stand, restore the board's
values, and close the port."""

MAX_BYTES = 65_536
STATUS = b"status\n"
STOP = b"stop by yahboomd stop\n"
"""Any request but ``status`` engages; this one names the program that asks."""


class Talk:
    """One request on one socket, and the lines of the answer.

    Attributes:
        connected: A guard has the request, or its queue is full.
        pid: The process that listens there; 0 if it is in another PID namespace.
        uid: Its user, reported by the kernel; None before the connection.
    """

    def __init__(self, path: str, request: bytes) -> None:
        self.path = path
        self.lines: list[dict[str, Any]] = []
        self.connected = True
        self.pid = 0
        self.uid: int | None = None
        self._data = b""
        self._sock = sock = socket.socket(socket.AF_UNIX)
        # The kernel lets the connection wait for room in the queue.
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, _timeval(STATUS_WITHIN_S))
        try:
            connect(sock, path)
            raw = sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("iII"))
            self.pid, self.uid, _ = struct.unpack("iII", raw)
            sock.send(request, socket.MSG_NOSIGNAL)
        except (BlockingIOError, BrokenPipeError):
            # Of a refusal the reason can be read.
            return
        except OSError:
            self.connected = False

    def read(self, lines: int, until_s: float) -> None:
        """Read until there are this many lines, or no more come."""
        left_s = max(0.001, until_s - time.monotonic())
        while self.connected and len(self.lines) < lines and left_s > 0.0:
            self._sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, _timeval(left_s))
            try:
                data = self._sock.recv(MAX_BYTES)
            except OSError:
                return
            left_s = until_s - time.monotonic()
            self._data += data
            if not data or len(self._data) > MAX_BYTES:
                return
            *whole, self._data = self._data.split(b"\n")
            for line in whole:
                with contextlib.suppress(ValueError, RecursionError):
                    facts = json.loads(line)
                    if isinstance(facts, dict):
                        self.lines.append(facts)

    def close(self) -> None:
        self._sock.close()


def ask_each(requests: Iterable[tuple[str, bytes]]) -> list[Talk]:
    """Ask at several sockets at once, so that one that is stuck holds no other stop up."""
    talks: dict[int, Talk] = {}

    def ask(number: int, path: str, request: bytes) -> None:
        talks[number] = Talk(path, request)

    asking = [threading.Thread(target=ask, args=(n, *each)) for n, each in enumerate(requests)]
    for thread in asking:
        try:
            thread.start()
        except RuntimeError:
            # There is no room for a thread.
            thread.run()
    for thread in asking:
        if thread.ident is not None:
            thread.join()
    return [talks[number] for number in range(len(asking))]


def _timeval(seconds: float) -> bytes:
    # Zero would be no limit.
    micros = max(1, int(seconds * 1e6))
    return struct.pack("ll", micros // 1_000_000, micros % 1_000_000)


class DaemonChoice(NamedTuple):
    """A choice among daemons. None and empty fields fit all.

    Attributes:
        listen: Endpoints of the daemon; one match is enough.
    """

    port: str = ""
    namespace: str | None = None
    listen: tuple[str, ...] = ()

    def fits(self, robot: LocalDaemon) -> bool:
        """Whether a daemon is meant. A daemon that did not answer may still hold the port."""
        if self.port:
            return any(same_port(self.port, each) for each in robot.ports) or holds(
                robot.guard, self.port
            )
        if robot.silent or robot.command:
            return self.namespace is None and not self.listen
        if self.namespace is not None and self.namespace != robot.namespace:
            return False
        return not self.listen or bool({*self.listen} & {*robot.listen})


class LocalDaemon(NamedTuple):
    """A daemon of this machine, or a tool that turns wheels without one.

    Attributes:
        pid: Its process, as it says; that of its guard if it says nothing.
        guard: The process that listens there; 0 if it is in another PID namespace.
        uid: Its user; None if it is not known.
        silent: It did not answer.
        ports: The serial port, as configured and as opened.
        listen: Its Zenoh endpoints.
        command: ``setup`` or ``tune`` if it is no daemon but one of them; else empty.
    """

    socket: str
    pid: int
    silent: bool = False
    namespace: str = ""
    ports: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
    uid: int | None = None
    guard: int = 0
    command: str = ""

    @property
    def believed(self) -> bool:
        """Whether its report that the wheels stand is enough."""
        return believed(self.guard, self.uid, self.socket, self.ports)

    @property
    def name(self) -> str:
        """In a sentence: ``bot1 (pid 12, /dev/ttyUSB0)``."""
        facts = ", ".join((f"pid {self.pid}", *self.ports[:1]))
        return plain(f"{self.namespace or f'yahboomd {self.command}'.rstrip()} ({facts})")


class StopOutcome(NamedTuple):
    """The result of a stop.

    Attributes:
        words: The answer and the observed motion, for a person.
        stood: The wheels were seen to stand.
        blind: No counts came.
    """

    robot: LocalDaemon
    words: str
    stood: bool
    blind: bool = False


class LocalStops:
    """The stops of all daemons and tools that are meant.

    Attributes:
        silent: Those whose guard does not answer: frozen, or busy for too long.
        others: Those that are not meant, and were left alone.
    """

    def __init__(self) -> None:
        self.answering: list[LocalDaemon] = []
        self.wanted = DaemonChoice()
        self.silent: list[LocalDaemon] = []
        self.others: list[LocalDaemon] = []
        self._meant: list[tuple[LocalDaemon, Talk]] = []

    def engage(self, wanted: DaemonChoice, found: Iterable[LocalDaemon]) -> None:
        """Stop them; returns once each that answers has stopped its robot.

        It does not wait for the others: their guards have the request.
        """
        self.wanted = wanted
        meant = list[LocalDaemon]()
        for robot in found:
            if not robot.silent:
                self.answering.append(robot)
            (meant if wanted.fits(robot) else self.others).append(robot)
        self._meant = [*zip(meant, ask_each((each.socket, STOP) for each in meant), strict=True)]
        until_s = time.monotonic() + ENGAGED_WITHIN_S
        for robot, talk in self._meant:
            if not (robot.silent or robot.command):
                talk.read(1, until_s)

    def outcomes(self) -> list[StopOutcome]:
        """Wait some seconds until the wheels stand; returns the outcome of each stop."""
        began_s, found = time.monotonic(), []
        for robot, talk in sorted(self._meant, key=lambda each: each[0].command):
            talk.read(2, began_s + (ENDED_WITHIN_S if robot.command else STOOD_WITHIN_S))
            talk.close()
            if not talk.lines or talk.lines[0].get("engaged") is not True:
                self.silent.append(robot)
                continue
            named = robot
            if (robot.guard, robot.uid) != (talk.pid, talk.uid):
                # The socket belonged to another process when the port was named.
                named = robot._replace(guard=talk.pid, uid=None)
            found.append(_outcome(named, talk.lines))
        return found


def find(environ: Mapping[str, str], within_s: float | None = None) -> list[LocalDaemon]:
    """The daemons and tools of this machine that this user may stop."""
    talks = ask_each((path, STATUS) for path in sockets(environ))
    until_s = time.monotonic() + (STATUS_WITHIN_S if within_s is None else within_s)
    for talk in talks:
        talk.read(1, until_s)
        talk.close()
    refused = [talk for talk in talks if any("error" in line for line in talk.lines)]
    return [_robot(talk) for talk in talks if talk.connected and talk not in refused]


def covered(outcome: StopOutcome, paths: Iterable[str]) -> bool:
    """Whether a daemon without counts has no board, because another process holds its port."""
    return outcome.blind and any(
        same_port(port, path) for port in outcome.robot.ports for path in paths
    )


def vouched_for(outcome: StopOutcome, paths: Iterable[str]) -> bool:
    """Whether a trusted process has judged each port that a daemon names."""
    ports = outcome.robot.ports
    return bool(ports) and all(any(same_port(port, path) for path in paths) for port in ports)


def drives(robots: Iterable[LocalDaemon], path: str) -> bool:
    """Whether one of these daemons has a port, or names it and is believed."""
    return any(
        holds(robot.guard, path)
        or (robot.believed and any(same_port(port, path) for port in robot.ports))
        for robot in robots
    )


def unproved(outcome: StopOutcome) -> str:
    """Report the answer of a process that is not believed as its user's."""
    robot = outcome.robot
    who = "Somebody" if robot.uid is None else f"User {robot.uid}"
    return (
        f"{who} answers on {robot.socket}, as {robot.name}: {outcome.words!r} This proves nothing: "
        "no such process is seen to hold the port that it names. If wheels turn, switch the motor "
        "supply off."
    )


def there(robots: Sequence[LocalDaemon], command: str) -> str:
    """Name the other daemons here, each with the command that reaches it; empty for none."""
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


def notes(
    environ: Mapping[str, str], wanted: DaemonChoice, living: Iterable[LocalDaemon]
) -> list[PortNote]:
    """The notes of daemons that neither answer nor ended in order."""
    # A killed daemon's process id may belong to any process by now.
    pids = {robot.pid for robot in living if robot.believed}
    found = []
    for folder in folders(environ):
        with contextlib.suppress(OSError):
            # The folder's owner chooses the file, so trust only root and this user.
            if os.stat(folder).st_uid in {0, os.geteuid()}:
                found += [each for each in port_note.read(folder) if not each.ended or each.latch]
    return [
        note
        for note in found
        if note.pid not in pids
        and wanted.fits(LocalDaemon("", note.pid, False, note.namespace, (note.path,), note.listen))
    ]


def _trusted(path: str) -> bool:
    """Whether no stranger made the folder: below /tmp it must belong to its user."""
    folder = os.path.dirname(path)
    try:
        if not os.stat(os.path.dirname(folder)).st_mode & 0o002:
            return True
        status = os.lstat(folder)
    except OSError:
        return False
    named = folder.rpartition("-")[2]
    return status.st_uid in {0, os.geteuid()} or named == str(status.st_uid)


def _robot(talk: Talk) -> LocalDaemon:
    facts = talk.lines[0] if talk.lines else {}
    if facts.get("daemon") != "yahboomd":
        return LocalDaemon(talk.path, talk.pid, silent=True, uid=talk.uid, guard=talk.pid)
    ports = _texts(facts.get("ports"))
    if talk.uid not in {0, os.geteuid()}:
        # Another user's link may lead to the wanted port now, and to a port of theirs later.
        ports = tuple(settled(port) or port for port in ports)
    return LocalDaemon(
        talk.path,
        facts["pid"] if isinstance(facts.get("pid"), int) else talk.pid,
        namespace=str(facts.get("namespace", "")),
        ports=ports,
        listen=_texts(facts.get("listen")),
        uid=talk.uid,
        guard=talk.pid,
        command=str(facts.get("command", "")),
    )


def _texts(value: object) -> tuple[str, ...]:
    return tuple(map(str, value)) if isinstance(value, list) else ()


def same_port(one: str, other: str) -> bool:
    """Whether two paths lead to the same device."""
    return os.path.realpath(one) == os.path.realpath(other)


def _outcome(robot: LocalDaemon, lines: Sequence[dict[str, Any]]) -> StopOutcome:
    words = pasteable(plain(str(lines[0].get("message", ""))))
    seen = lines[1] if len(lines) > 1 else {}
    stood, fastest = seen.get("stood") is True, seen.get("fastest_m_s")
    fastest_m_s = float(fastest) if isinstance(fastest, int | float) else None
    blind = not stood and fastest_m_s is None
    missing = next((port for port in robot.ports if blind and not os.path.exists(port)), "")
    if blind and lines[0].get("sent") is False:
        words += " The wheels may still turn: switch the motor supply off."
    elif missing:
        words = (
            f"{words.removesuffix('.')}, but {missing} is gone, so no stop reached the board. "
            "The wheels may still turn: switch the motor supply off."
        )
    elif robot.command and stood:
        words += " The wheels stand."
    elif not seen:
        words += " Whether they stand was not seen: if they turn, switch the motor supply off."
    else:
        again = release_command(robot.namespace, robot.listen)
        words += f" {verdict(fastest_m_s, stood=stood, again=again)}"
    return StopOutcome(robot, words, stood=stood, blind=blind)


def verdict(fastest_m_s: float | None, *, stood: bool, again: str) -> str:
    """State whether the wheels stand, for a person.

    Args:
        fastest_m_s: The fastest wheel at the end; None if no counts came.
        stood: They were seen to stand.
        again: The command that releases the emergency stop.
    """
    if stood:
        return pasteable(f"The wheels stand. To drive again: {again}")
    if fastest_m_s is not None:
        return f"The wheels still turn, at {fastest_m_s:.2f} m/s: switch their supply off."
    return (
        "The daemon receives no counts from the board, so it cannot see whether the wheels stand. "
        "Look at them: if they turn, switch the motor supply off."
    )
