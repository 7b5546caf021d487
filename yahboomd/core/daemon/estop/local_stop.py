"""Stopping over a local socket, which needs no Zenoh session and waits behind none.

One connection, one request: a line with a word in, lines of JSON out. ``status`` returns which
robot this is; any other request engages the emergency stop, as on the bus. Bytes, connections and
their time are bounded, so that no local flood locks a stop out. One descriptor is kept for the
connection that comes when all others are taken.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import json
import logging
import os
import socket
from collections import Counter
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import Any

from yahboomd.core.bus.blocking import bounded
from yahboomd.core.daemon.estop.local_socket import Listening, Peer, listen, peer_of
from yahboomd.core.messages.native import ServiceReply
from yahboomd.core.program import readable
from yahboomd.core.standstill import Standstill

log = logging.getLogger(__name__)

NAME = "stop"
STATUS = b"status\n"
BY_COMMAND = b" by yahboomd stop"
"""The end of each request of ``yahboomd stop``, so that texts name the command."""

MAX_BYTES = 256
MAX_SILENT = 16
"""Connections that have not asked yet; one more closes the oldest."""

MAX_WATCHING = 32
"""Connections that wait for the outcome; one more learns only that the stop is engaged."""

ACCEPTS = 32
"""Connections accepted in one iteration of the loop, so that a flood does not starve the rest; more
than those who flood make room for in the queue."""

OPEN_WITHIN_S = 2.0
REQUEST_WITHIN_S = 1.0
STAND_WITHIN_S = 2.0
LOOK_S = 5.0
"""The period of the check that programs still find the socket."""

PAUSE_S = 0.1
"""The pause after connections could not be accepted, for example without descriptors."""


class _Watch:
    """Watches the readings after a stop until the wheels stand."""

    def __init__(self) -> None:
        self.standing = asyncio.Event()
        self.fastest_m_s: float | None = None
        self._standstill = Standstill()

    def observe(self, stamp_ns: int, speeds_m_s: tuple[float, ...]) -> None:
        self.fastest_m_s = max(map(abs, speeds_m_s))
        if self._standstill.measure(stamp_ns, speeds_m_s):
            self.standing.set()


class _Connection:
    def __init__(self, sock: socket.socket, peer: Peer) -> None:
        self.sock = sock
        self.peer = peer
        self.data = b""
        self.timer: asyncio.TimerHandle | None = None


class LocalStop:
    """Listens, and stops the robot.

    Args:
        engage: Engages the emergency stop, given its origin; returns a sentence.
        acknowledged: Given this sentence, returns the answer once the stop was sent and is on file.
        facts: Returns the robot's identity and its state.
        name: The name of the socket's file.
    """

    def __init__(
        self,
        folder: Path,
        *,
        engage: Callable[[str], str],
        acknowledged: Callable[[str], Awaitable[ServiceReply]],
        facts: Callable[[], dict[str, Any]],
        name: str = NAME,
    ) -> None:
        self._folder = folder
        self._name = name
        self._engage = engage
        self._acknowledged = acknowledged
        self._facts = facts
        self._listening: Listening | None = None
        self._silent: dict[_Connection, None] = {}
        self._watches: dict[_Watch, None] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._counters: Counter[str] = Counter()
        self._spare: int | None = None
        self._attending: asyncio.Task[None] | None = None

    async def open(self) -> None:
        """Listen; if that fails the daemon continues, and logs it."""
        try:
            await self._listen()
        except (OSError, TimeoutError) as error:
            log.warning(
                "No local socket in %s (%s): `yahboomd stop` reaches this daemon over the bus "
                "alone.",
                self._folder,
                error or "the disk hangs",
            )
        self._attending = asyncio.ensure_future(self._attend())

    async def _listen(self) -> None:
        self._listening = listening = await bounded(
            lambda: listen(self._folder, self._name),
            timeout_s=OPEN_WITHIN_S,
            name="local-stop",
            late=lambda late: late.close(),
        )
        self._keep_spare()
        asyncio.get_running_loop().add_reader(listening.sock, self._accept, listening)

    async def _attend(self) -> None:
        """Listen again if the folder was removed, as at the end of its user's last session."""
        while True:
            await asyncio.sleep(LOOK_S)
            with contextlib.suppress(OSError, TimeoutError):
                if (listening := self._listening) is not None:
                    if await bounded(
                        listening.is_there, timeout_s=OPEN_WITHIN_S, name="local-stop"
                    ):
                        continue
                    self._hang_up()
                await self._listen()
                log.info("The local socket is there again: %s", self._folder)

    def close(self) -> None:
        for task in (self._attending, *self._tasks):
            if task is not None:
                task.cancel()
        for connection in tuple(self._silent):
            self._forget(connection).close()
        self._hang_up()
        self._give_spare()

    def _hang_up(self) -> None:
        if self._listening is not None:
            asyncio.get_running_loop().remove_reader(self._listening.sock)
            self._listening.close()
            self._listening = None

    def observe(self, stamp_ns: int, speeds_m_s: tuple[float, ...]) -> None:
        for watch in self._watches if speeds_m_s else ():
            watch.observe(stamp_ns, speeds_m_s)

    def status_values(self) -> dict[str, Any]:
        """For the status: the path of the socket, and counts of connections."""
        path = "" if self._listening is None else readable(str(self._listening.path))
        names = ("stops", "refused", "dropped")
        return {"local_socket": path} | {f"local_{name}": self._counters[name] for name in names}

    def _accept(self, listening: Listening) -> None:
        for _ in range(ACCEPTS):
            try:
                sock = self._next(listening)
            except (BlockingIOError, InterruptedError, ConnectionError):
                return
            except OSError as error:
                self._counters["dropped"] += 1
                log.debug("A local connection could not be accepted: %s", error)
                loop = asyncio.get_running_loop()
                loop.remove_reader(listening.sock)
                loop.call_later(PAUSE_S, self._resume, listening)
                return
            self._admit(sock, listening)
            if self._spare is None:
                # It has the last descriptor.
                return

    def _next(self, listening: Listening) -> socket.socket:
        try:
            return listening.sock.accept()[0]
        except OSError as error:
            if error.errno not in {errno.EMFILE, errno.ENFILE} or not self._give_spare():
                raise
        return listening.sock.accept()[0]

    def _end(self, sock: socket.socket) -> None:
        sock.close()
        self._keep_spare()

    def _keep_spare(self) -> None:
        if self._spare is None and self._listening is not None:
            with contextlib.suppress(OSError):
                self._spare = os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)

    def _give_spare(self) -> bool:
        spare, self._spare = self._spare, None
        if spare is not None:
            os.close(spare)
        return spare is not None

    def _resume(self, listening: Listening) -> None:
        if self._listening is listening:
            self._keep_spare()
            asyncio.get_running_loop().add_reader(listening.sock, self._accept, listening)

    def _admit(self, sock: socket.socket, listening: Listening) -> None:
        sock.setblocking(False)
        try:
            peer = peer_of(sock)
        except OSError:
            self._end(sock)
            return
        if not listening.may_use(peer):
            self._counters["refused"] += 1
            _send(sock, error=f"User {peer.uid} is not in the group of {listening.path}.")
            self._end(sock)
            if self._counters["refused"] == 1:
                log.warning("The local socket refused user %d (pid %d).", peer.uid, peer.pid)
            return
        connection = _Connection(sock, peer)
        self._silent[connection] = None
        self._read(connection)
        if connection not in self._silent:
            return
        loop = asyncio.get_running_loop()
        connection.timer = loop.call_later(REQUEST_WITHIN_S, self._decide, connection)
        loop.add_reader(sock, self._read, connection)
        if len(self._silent) > MAX_SILENT:
            oldest = next(iter(self._silent))
            # Its request may have arrived by now.
            self._read(oldest)
            if oldest in self._silent:
                self._decide(oldest)

    def _read(self, connection: _Connection) -> None:
        try:
            data = connection.sock.recv(MAX_BYTES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        connection.data += data
        may_be_status = STATUS.startswith(connection.data) and connection.data != STATUS
        if not data or not may_be_status:
            self._decide(connection)

    def _decide(self, connection: _Connection) -> None:
        sock = self._forget(connection)
        asked = connection.data.strip()
        if not connection.data:
            self._counters["dropped"] += 1
            self._end(sock)
        elif asked == STATUS.strip():
            _send(sock, **self._facts())
            self._end(sock)
        else:
            peer = connection.peer
            program = "`yahboomd stop`" if asked.endswith(BY_COMMAND) else "the local socket"
            user = "root" if peer.uid == 0 else f"user {peer.uid}"
            # Before everything else.
            words = self._engage(f"{program} ({user}, pid {peer.pid})")
            self._counters["stops"] += 1
            if len(self._tasks) >= MAX_WATCHING:
                words = f"{words} Too many wait to learn whether it was sent: see the status."
                _send(sock, engaged=True, sent=None, message=words)
                self._end(sock)
                return
            watch = _Watch()
            task = asyncio.ensure_future(self._report(sock, words, watch))
            self._tasks.add(task)
            task.add_done_callback(partial(self._ended, sock, watch))

    async def _report(self, sock: socket.socket, words: str, watch: _Watch) -> None:
        reply = await self._acknowledged(words)
        # Readings from before it was sent prove nothing.
        self._watches[watch] = None
        _send(sock, engaged=True, sent=reply.success, message=reply.message)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(STAND_WITHIN_S):
                await watch.standing.wait()
        fastest = watch.fastest_m_s
        stood = None if fastest is None else watch.standing.is_set()
        _send(sock, stood=stood, fastest_m_s=fastest, why=self._facts().get("why", ""))

    def _ended(self, sock: socket.socket, watch: _Watch, task: asyncio.Task[None]) -> None:
        self._end(sock)
        self._watches.pop(watch, None)
        self._tasks.discard(task)

    def _forget(self, connection: _Connection) -> socket.socket:
        del self._silent[connection]
        asyncio.get_running_loop().remove_reader(connection.sock)
        if connection.timer is not None:
            connection.timer.cancel()
        return connection.sock


def _send(sock: socket.socket, **facts: object) -> None:
    with contextlib.suppress(OSError):
        sock.send(json.dumps(facts).encode() + b"\n", socket.MSG_NOSIGNAL)
