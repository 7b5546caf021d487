"""Local stops, at the guard's socket: who may ask, what is asked, and who waits for an answer.

One connection, one request: what arrives first decides. ``status`` returns which robot this is, and
the next owner of a port asks for it; any other bytes ask for the emergency stop. Connections and
their bytes are bounded, so that no local flood locks a stop out.

The standard library alone is needed.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import json
import os
import select
import socket
import time
from collections import Counter
from glob import escape, glob
from typing import NamedTuple

from yahboomd.core.link.guard_words import HELD, NEXT
from yahboomd.tools.stop import local_socket

STATUS = b"status"
BY_COMMAND = b" by yahboomd stop"
"""The end of each request of ``yahboomd stop``, so that texts name the command."""

MAX_BYTES = 256
MAX_SILENT = 16
"""Connections that have not asked yet; one more closes the oldest."""

MAX_WAITING = 32
"""Connections that wait for the outcome; one more learns only that the stop is engaged."""

PAUSE_S = 0.01
"""The pause after a connection could not be accepted, for example without descriptors."""

NAMES_TRIED = 9


class MadeSocket(NamedTuple):
    """A socket that listens, its path, and the state of its file."""

    path: str
    sock: socket.socket
    status: os.stat_result


class Request(NamedTuple):
    """A request that a program made.

    Attributes:
        number: Of a stop; answers name it.
        by: Who asks for a stop; empty if this is no stop.
        verb: ``next`` or ``held``, of a program that is trusted; else empty.
        device: The number of the device that such a program names.
        pid: The process that asks.
    """

    number: int = 0
    by: str = ""
    verb: bytes = b""
    device: int = 0
    pid: int = 0


class _Connection:
    def __init__(self, sock: socket.socket, peer: local_socket.Peer) -> None:
        self.sock = sock
        self.peer = peer
        self.number = 0
        self.answered = False


class LocalStops:
    """Listens, reads requests, and answers.

    Args:
        number: Of the newest stop that was asked for, by a guard before this one perhaps.

    Attributes:
        counters: Requests, by kind.
        facts: What ``status`` returns.
        path: Of the socket; empty while there is none.
    """

    def __init__(self, number: int = 0) -> None:
        self.number = number
        self.counters: Counter[str] = Counter()
        self.facts = b"{}"
        self.path = ""
        self._epoll = select.epoll()
        self._listening: socket.socket | None = None
        self._inode = self._group = 0
        self._connections: dict[int, _Connection] = {}

    def fileno(self) -> int:
        """A descriptor that is readable while something has to be taken."""
        return self._epoll.fileno()

    # The socket.

    def made(self, folder: str, name: str) -> MadeSocket | None:
        """A socket ``name.sock`` in a folder, or ``name-PID.sock`` if another guard has that.

        One that programs still find by the better name stays: None. This blocks for as long as the
        disk, and changes nothing here, so that another thread may do it.

        Raises:
            OSError: The folder cannot be used, or no name is free.
        """
        from pathlib import Path

        from yahboomd.core.daemon.folder import prepare_folder

        best = f"{folder}/{name}.sock"
        prepare_folder(Path(folder))
        fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            if self._there() and (self.path == best or local_socket.lives(fd, best)):
                return None
            # Two that start at once must not take each other's file for a dead one's. Somebody
            # who may read the folder could hold the lock indefinitely, so it is not waited for.
            with contextlib.suppress(BlockingIOError):
                fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self._unlink()
            for old in glob(f"{escape(folder)}/{name}-*.sock"):
                if not local_socket.lives(fd, old):
                    local_socket.unlink(old)
            own = f"{folder}/{name}-{os.getpid()}"
            for path in (best, f"{own}.sock", *(f"{own}-{n}.sock" for n in range(2, NAMES_TRIED))):
                if not local_socket.lives(fd, path):
                    local_socket.unlink(path)
                    return MadeSocket(path, *local_socket.bound(fd, path))
        finally:
            os.close(fd)
        raise OSError(errno.EADDRINUSE, f"other guards have every name {folder}/{name}-*.sock")

    def listen(self, path: str, sock: socket.socket, status: os.stat_result) -> None:
        """Listen on a socket that was made, instead of the one before."""
        if self._listening is not None:
            self._listening.close()
        self.path, self._listening = path, sock
        self._inode, self._group = status.st_ino, status.st_gid
        self._epoll.register(sock, select.EPOLLIN)

    def _there(self) -> bool:
        """Whether programs find the socket: its file is not gone, nor another guard's."""
        with contextlib.suppress(OSError):
            return self.path != "" and os.lstat(self.path).st_ino == self._inode
        return False

    def close(self) -> None:
        """End all of it: first what a disk cannot hold up."""
        for connection in [*self._connections.values()]:
            self._forget(connection)
        if self._listening is not None:
            self._listening.close()
        self._epoll.close()
        self._unlink()

    def _unlink(self) -> None:
        """Remove the socket's file, unless it is another guard's by now."""
        if self._there():
            local_socket.unlink(self.path)

    # Requests.

    def take(self) -> list[Request]:
        """The requests that have come."""
        found = []
        for fd, _ in self._epoll.poll(0):
            if self._listening is not None and fd == self._listening.fileno():
                self._accept()
            elif (connection := self._connections.get(fd)) is not None:
                found += self._read(connection)
        return found

    def _accept(self) -> None:
        assert self._listening is not None
        try:
            sock = self._listening.accept()[0]
        except (BlockingIOError, InterruptedError, ConnectionError):
            return
        except OSError:
            self.counters["dropped"] += 1
            self._close_oldest()
            time.sleep(PAUSE_S)
            return
        try:
            peer = local_socket.peer_of(sock)
        except OSError:
            sock.close()
            return
        if not self.may_use(peer):
            self.counters["refused"] += 1
            _send(sock, error=f"User {peer.uid} is not in the group of {self.path}.")
            sock.close()
            return
        sock.setblocking(False)
        self._connections[sock.fileno()] = _Connection(sock, peer)
        self._epoll.register(sock, select.EPOLLIN)
        if sum(not each.number for each in self._connections.values()) > MAX_SILENT:
            self._close_oldest()

    def may_use(self, peer: local_socket.Peer) -> bool:
        """Whether a process may: root, the owner's user, and members of the file's group."""
        return _trusted(peer) or self._group in peer.groups

    def _close_oldest(self) -> None:
        silent = (each for each in self._connections.values() if not each.number)
        if (oldest := next(silent, None)) is not None:
            self.counters["dropped"] += 1
            self._forget(oldest)

    def _read(self, connection: _Connection) -> list[Request]:
        try:
            data = connection.sock.recv(MAX_BYTES)
        except BlockingIOError:
            return []
        except OSError:
            data = b""
        if not data or connection.number:
            self.counters["dropped"] += not connection.number
            self._forget(connection)
            return []
        verb, _, value = (asked := data.strip()).partition(b" ")
        if asked == STATUS:
            with contextlib.suppress(OSError):
                connection.sock.send(self.facts + b"\n", socket.MSG_NOSIGNAL)
        elif verb in {NEXT, HELD} and value.isdigit():
            self._forget(connection)
            if _trusted(connection.peer):
                return [Request(verb=verb, device=int(value), pid=connection.peer.pid)]
            self.counters["refused"] += 1
            return []
        else:
            return [self._stop(connection, asked)]
        self._forget(connection)
        return []

    def _stop(self, connection: _Connection, asked: bytes) -> Request:
        peer = connection.peer
        program = "`yahboomd stop`" if asked.endswith(BY_COMMAND) else "the local socket"
        waiting = sum(each.number > 0 for each in self._connections.values())
        self.number += 1
        connection.number = self.number
        if waiting >= MAX_WAITING:
            message = "Emergency stop asked for. Too many wait to learn whether it was sent."
            _send(connection.sock, engaged=True, sent=None, message=message)
            self._forget(connection)
        else:
            # From now on only its end is of interest.
            self._epoll.modify(connection.sock, 0)
        return Request(number=self.number, by=f"{program} ({peer.user}, pid {peer.pid})")

    # Answers.

    def answer(self, number: int, line: bytes) -> None:
        """Answer each stop up to a number that was not answered yet."""
        for connection in [*self._connections.values()]:
            if 0 < connection.number <= number and not connection.answered:
                connection.answered = True
                with contextlib.suppress(OSError):
                    connection.sock.send(line + b"\n", socket.MSG_NOSIGNAL)

    def finish(self, number: int, line: bytes) -> None:
        """Tell what was seen of the wheels to each stop up to a number, which ends it."""
        for connection in [*self._connections.values()]:
            if 0 < connection.number <= number and connection.answered:
                with contextlib.suppress(OSError):
                    connection.sock.send(line + b"\n", socket.MSG_NOSIGNAL)
                self._forget(connection)

    def _forget(self, connection: _Connection) -> None:
        self._connections.pop(connection.sock.fileno(), None)
        connection.sock.close()


def _trusted(peer: local_socket.Peer) -> bool:
    return peer.uid in {0, os.geteuid()}


def _send(sock: socket.socket, **facts: object) -> None:
    with contextlib.suppress(OSError):
        sock.send(json.dumps(facts).encode() + b"\n", socket.MSG_NOSIGNAL)
