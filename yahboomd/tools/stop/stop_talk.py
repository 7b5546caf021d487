"""Sends requests to daemons' local sockets, all at once, without asyncio. See docs/bus.md."""

from __future__ import annotations

import contextlib
import json
import os
import select
import socket
import struct
import time
from collections.abc import Iterable
from typing import Any

RETRY_S = 0.002
"""Between tries at a full queue: frequent, because other clients compete for it."""

MAX_BYTES = 65_536

_LONGEST_PATH = 100


class Talk:
    """One request on one socket, and the lines of the answer.

    Attributes:
        crowded: A process listens, and its queue was full.
        pid: The process that listens there; 0 if it is in another PID namespace.
        uid: Its user, reported by the kernel; None before the connection.
    """

    def __init__(self, path: str, request: bytes) -> None:
        self.path = path
        self.lines: list[dict[str, Any]] = []
        self.connected = False
        self.crowded = False
        self.ended = False
        self.pid = 0
        self.uid: int | None = None
        self._request = request
        self._data = b""
        self.sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)

    def connect(self) -> None:
        """Connect and send the request; the caller tries a full queue again."""
        try:
            _connect(self.sock, self.path)
            size = struct.calcsize("iII")
            raw = self.sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, size)
            self.pid, self.uid, _ = struct.unpack("iII", raw)
            self.connected = True
            self.sock.send(self._request, socket.MSG_NOSIGNAL)
        except BlockingIOError:
            self.crowded = True
        except BrokenPipeError:
            # The daemon refused, and the reason can be read.
            return
        except OSError:
            self.ended = True

    def read(self) -> None:
        """Receive bytes, and cut them into lines."""
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
            with contextlib.suppress(ValueError, RecursionError):
                facts = json.loads(line)
                if isinstance(facts, dict):
                    self.lines.append(facts)

    def close(self) -> None:
        self.sock.close()


def converse(talks: Iterable[Talk], *, lines: int, within_s: float) -> None:
    """Run all of them at once, until each has this many lines, or has ended."""
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
