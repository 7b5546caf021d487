"""The guard of this process's port, which stops the wheels when this process no longer can.

The guard is a process of its own (:mod:`yahboomd.tools.port.guard`) that shares the open port: its
stop needs no port to be opened. The kernel's lock belongs to what both share, so that this process
closes its port only once the guard has closed it, too.

This process promises to be here again in a moment, in each control step. If the promise lapses the
guard stops the wheels, and from then on this process writes no motion until it has acknowledged
that stop by its number.

What the two say is in :mod:`~yahboomd.core.link.guard_words`.
"""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import json
import logging
import os
import select
import socket
import subprocess
import termios
from collections import deque
from collections.abc import Callable, Sequence
from typing import Protocol

from yahboomd.core.clock import Clock, nanoseconds, sleep_until
from yahboomd.core.link import guard_words as words
from yahboomd.core.link import port_note
from yahboomd.core.link.port_note import PortNote
from yahboomd.core.link.promise import Promise, memory
from yahboomd.core.protocol.dialect import Dialect

log = logging.getLogger(__name__)

ANSWERS_WITHIN_S = 10.0
STARTS_WITHIN_S = 5.0
"""The first answer of a process that a busy machine may just be starting."""
CLOSES_WITHIN_S = 0.2
ENDS_WITHIN_S = 2.0

LOOK_S = 0.005

NO_GUARD = (
    "No wheel is turned until a guard has the port: nothing else would stop the wheels if yahboomd "
    "were killed or froze. If this lasts, free memory, processes and file descriptors, and start "
    "yahboomd again; `--no-guard` drives without."
)

FAR_MS = 10**15
"""A promise without an end: a port was opened just now, or a tool waits for a person."""

NS_PER_MS = 1_000_000

SEEN_MS = 500
"""The period at which a guard is seen to be there."""

MOST_UNHEARD = 3
"""A guard that did not read its message for so many of these periods is replaced."""

LISTENS_WITHIN_S = 2.0
"""A disk may hang."""

NO_SOCKET = "`yahboomd stop` reaches this process over the bus alone."

StartGuard = Callable[[int], tuple["subprocess.Popen[bytes]", socket.socket]]


def stops_of(dialect: Dialect) -> tuple[bytes, bytes]:
    """The guard's stops: zero speed, and the surest; from any state of the board's parser."""
    return dialect.resync + dialect.brake, dialect.resync + dialect.surest_stop


class SharedPort(Protocol):
    """What a guard's owner needs of the port that it shares."""

    def fileno(self) -> int:
        """Its descriptor."""

    @property
    def pending(self) -> int:
        """Bytes that the kernel did not take yet."""

    def write(self, data: bytes) -> None:
        """Send; never raises."""


class PortGuard:
    """A guard as its owner sees it; without a process behind it every message is dropped.

    Args:
        start: Starts the process on the promise's memory; returns it with a socket for packets.
        renewed: Start another one in place of a guard that ended or does not answer.

    Attributes:
        socket: The path of the socket for local stops; empty for none, None while it is not known.
    """

    def __init__(self, start: StartGuard | None = None, *, renewed: bool = True) -> None:
        self._start = start
        self._renewed = renewed
        self._process: subprocess.Popen[bytes] | None = None
        self._channel: socket.socket | None = None
        self._memory = -1
        self._promise: Promise | None = None
        self._port: SharedPort | None = None
        self._fd: int | None = None
        self._note: PortNote | None = None
        self._resync = self._stop = b""
        self._closed_after = 0
        self._answered = self._ended = self._holds = False
        self._device = b""
        self._told = self._due = self._unheard = 0
        self._answers: deque[bytes] = deque()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._listening: words.Listening | None = None
        self._on_stop: Callable[[int, str], None] = lambda _number, _by: None
        self._facts = b""
        self.socket: str | None = None

    def begin(self) -> None:
        """Start the process.

        Raises:
            OSError: It does not start.
        """
        if self._start is None:
            return
        if self._promise is None:
            self._memory = memory()
            self._promise = Promise(self._memory)
        self._process, self._channel = self._start(self._memory)
        self._channel.setblocking(False)
        self._answers.clear()
        self._ended = self._holds = False
        self._promise.read = self._told = self._due = self._unheard = 0
        self._watch()

    @property
    def gone(self) -> bool:
        """Whether there is no guard any more."""
        return self._start is not None and self._channel is None

    @property
    def watching(self) -> bool:
        """Whether it holds the port, if one is open. Until then no wheel must be commanded."""
        return self._start is None or self._port is None or self._holds

    # The port.

    def share(self, port: SharedPort, note: PortNote) -> None:
        """Share a port that was opened just now, until :meth:`close_port`.

        Args:
            note: The device and how it was opened.
        """
        self._port, self._note, self._resync, self._stop = port, note, b"", b""
        if self._promise is None:
            return
        with contextlib.suppress(OSError):
            # A port that went away is closed before it is known: its number may be another's.
            self._fd = os.dup(port.fileno())
            self._device = b"%d" % os.fstat(self._fd).st_rdev
        self._holds = False
        self._promise.until_ms = self._promise.until_ms or FAR_MS
        self._tell_port()

    async def watches(self, dialect: Dialect, clock: Clock) -> bool:
        """Whether the guard has the port of this board, whose wheels may turn."""
        self._resync = dialect.resync
        if self._channel is None or self._fd is None or self._promise is None:
            return False
        self._promise.until_ms = self._promise.until_ms or FAR_MS
        self._stop = b" ".join(each.hex().encode() for each in stops_of(dialect))
        self._tell(words.STOP, self._stop)
        for _ in range(2):
            until_ns = clock.now_ns() + nanoseconds(ANSWERS_WITHIN_S)
            while (
                (answer := self._answer()) is None and not self._holds and clock.now_ns() < until_ns
            ):
                await sleep_until(clock, clock.now_ns() + nanoseconds(LOOK_S))
            if self._holds:
                return True
            # It may have no free descriptor, and not know that it lost the port.
            self._answered = self._answered or bool(answer)
            self._replace()
        return False

    def close_port(self) -> None:
        """Wait until the guard has closed the port: then this process may close or open it."""
        fd, self._fd, self._port, self._holds = self._fd, None, None, False
        if self._promise is None or (fd is None and self._promise.stop == self._closed_after):
            # Since it closed the port last, there was no stop for which it opened it.
            return
        self._closed_after, channel = self._promise.stop, self._channel
        self._tell(words.CLOSE)
        if channel is not None and channel is self._channel and not self._closed(channel):
            self._replace()
        if fd is not None:
            # A guard that is being killed may have it a moment longer.
            with contextlib.suppress(OSError):
                fcntl.flock(fd, fcntl.LOCK_UN)
                fcntl.ioctl(fd, termios.TIOCNXCL)
            os.close(fd)

    def _closed(self, channel: socket.socket) -> bool:
        poll = select.poll()
        poll.register(channel, select.POLLIN)
        within_s = CLOSES_WITHIN_S if self._answered else STARTS_WITHIN_S
        while (answer := self._answer()) != words.CLOSED:
            if answer == b"" or (answer is None and not poll.poll(1000.0 * within_s)):
                return False
        self._answered = True
        return True

    # The wheels.

    def promise(self, until_ns: int) -> None:
        """Promise to be here again until then, and acknowledge the guard's stop, if there was one.

        From now on wheels may turn.
        """
        promise, until_ms = self._promise, until_ns // NS_PER_MS
        if promise is None:
            return
        before, promise.until_ms = promise.until_ms, until_ms
        if promise.asked != promise.obeyed or not self._holds:
            self._read()
        if promise.asked != promise.obeyed:
            # Its message may have found no room.
            self._on_stop(promise.asked, "the local socket")
        self._acknowledge(promise)
        if before == 0 or until_ms < before or until_ms // SEEN_MS != before // SEEN_MS:
            # The guard sleeps until the promise that it knows lapses. A message to it also shows
            # whether it was killed or is frozen.
            self._look_for_it(promise)

    def _look_for_it(self, promise: Promise) -> None:
        heard = promise.read >= self._due or not self._holds
        self._unheard = 0 if heard else self._unheard + 1
        if self._unheard >= MOST_UNHEARD:
            self._replace()
        self._due = self._told
        self._told += 1
        self._tell(words.PROMISE, b"%d" % self._told)

    def renew(self, until_ns: int) -> None:
        """Promise until then while this process starts, if wheels may turn."""
        if self._promise is not None and self._promise.until_ms:
            self.promise(until_ns)

    def standing(self) -> None:
        """The wheels were seen to stand, and none is driven before the next promise."""
        if self._promise is not None:
            self._promise.until_ms = 0
            self._acknowledge(self._promise)

    def heard(self, now_ns: int) -> None:
        """Counts of the board came: a relay in the motors' supply may hold."""
        if self._promise is not None:
            self._promise.heard_ms = now_ns // NS_PER_MS

    def let_go(self, without_power: bool) -> None:
        """The last command took the power off the motors: a stop of the guard does not brake."""
        if self._promise is not None:
            self._promise.let_go = without_power

    @property
    def stops(self) -> int:
        """The number of its newest stop."""
        return 0 if self._promise is None else self._promise.stop

    @property
    def stopped(self) -> bool:
        """Whether no motion must be written: a stop is not acknowledged, or asked for."""
        promise = self._promise
        return promise is not None and (
            promise.stop != promise.acknowledged or promise.asked != promise.obeyed
        )

    def _acknowledge(self, promise: Promise) -> None:
        stop, port = promise.stop, self._port
        if stop == promise.acknowledged:
            return
        if port is not None:
            if not port.pending:
                # The guard may have written half a frame, which would swallow the next one.
                port.write(self._resync)
            if port.pending:
                return
        promise.acknowledged = stop

    # Stops that other programs of this machine ask for.

    async def listen(
        self, listening: words.Listening, on_stop: Callable[[int, str], None], clock: Clock
    ) -> bool:
        """Have the guard listen for local stops, and hand them over.

        Args:
            on_stop: Takes the number of a stop, and who asks for it; it calls :meth:`obey`.

        Returns:
            False if it does not listen, though there should be a guard.
        """
        self._listening, self._on_stop = listening, on_stop
        if self._channel is None:
            return self._start is None
        self._loop = asyncio.get_running_loop()
        self._watch()
        self._tell(words.LISTEN, json.dumps(listening).encode())
        until_ns = clock.now_ns() + nanoseconds(LISTENS_WITHIN_S)
        while self.socket is None and clock.now_ns() < until_ns and not self.gone:
            await sleep_until(clock, clock.now_ns() + nanoseconds(LOOK_S))
        return bool(self.socket)

    def look_after_socket(self) -> None:
        """Have the guard listen again if programs do not find its socket any more."""
        if self._listening is not None:
            self._tell(words.LISTEN, json.dumps(self._listening).encode())

    def show(self, facts: bytes) -> None:
        """Have the socket's ``status`` return a line of JSON."""
        if facts != self._facts:
            self._facts = facts
            self._tell(words.FACTS, facts)

    def obey(self, number: int) -> None:
        """Note that the emergency stop was engaged for a request: motion may follow a release."""
        if self._promise is not None:
            self._promise.obeyed = max(self._promise.obeyed, number)

    def answer(self, number: int, line: bytes) -> None:
        """Tell each that asked for a stop, up to this number, whether it was sent."""
        self._tell(words.ANSWERED, b"%d %s" % (number, line))

    def tell_seen(self, number: int, line: bytes) -> None:
        """Tell them what was seen of the wheels."""
        self._tell(words.SEEN, b"%d %s" % (number, line))

    def want(self, path: str) -> None:
        """Ask the guard of a dead owner for a device that is held: it unlocks it for a moment."""
        with contextlib.suppress(OSError):
            self._tell(words.WANTED, b"%d" % os.stat(path).st_rdev)

    @property
    def stop_counts(self) -> tuple[int, int, int]:
        """Local stops, connections that were refused, and those that ended without a request."""
        promise = self._promise
        if promise is None:
            return 0, 0, 0
        return promise.asked, promise.refused, promise.dropped

    # The end.

    async def outcome(self, clock: Clock) -> str:
        """Leave the wheels to the guard, and wait until it has seen them stand.

        Returns:
            The outcome in words; empty if the guard was killed.
        """
        with contextlib.suppress(OSError):
            if self._channel is not None:
                self._channel.shutdown(socket.SHUT_WR)
        while True:
            answer = self._answer()
            if answer is None:
                await sleep_until(clock, clock.now_ns() + nanoseconds(LOOK_S))
            elif answer != words.CLOSED and not answer.isdigit():
                return answer.decode()

    def dismiss(self) -> None:
        """End the guard without a stop: a person takes care of the wheels."""
        if self._process is not None:
            self._process.kill()
        self.end(CLOSES_WITHIN_S)

    def end(self, within_s: float = 0.0) -> None:
        """End the guard; if the wheels may turn, it first sees them stand.

        Args:
            within_s: How long to wait for that. The guard goes on without this process.
        """
        process, self._process = self._process, None
        self._unwatch()
        if self._channel is not None:
            self._channel.close()
            self._channel = None
        if process is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(within_s)
            # Tells subprocess not to wait for it.
            process.returncode = 0

    # Messages.

    def _tell_all(self) -> None:
        if self._listening is not None:
            self._tell(words.LISTEN, json.dumps(self._listening).encode())
            self._tell(words.FACTS, self._facts)
        self._tell_port()

    def _tell_port(self) -> None:
        if self._note is not None:
            fds = [] if self._fd is None else [self._fd]
            self._tell(words.PORT, port_note.text_of(self._note).encode(), fds)
        if self._stop:
            self._tell(words.STOP, self._stop)

    def _tell(self, word: bytes, value: bytes = b"", fds: Sequence[int] = ()) -> None:
        if self._channel is None:
            return
        try:
            socket.send_fds(self._channel, [word, b" ", value], [*fds])
        except OSError:
            # It has ended, or is frozen and reads nothing.
            self._replace()

    def _answer(self) -> bytes | None:
        """The next packet from the guard; None if there is none yet, empty if it has ended."""
        self._read()
        if self._answers:
            return self._answers.popleft()
        return b"" if self._channel is None or self._ended else None

    def _read(self) -> None:
        """Read what the guard says: the newest request is obeyed, answers are kept."""
        asked = b""
        while self._channel is not None and not self._ended:
            try:
                packet = self._channel.recv(words.MAX_BYTES)
            except BlockingIOError:
                break
            except OSError:
                packet = b""
            name, _, value = packet.partition(b" ")
            if not packet:
                self._ended = True
                self._unwatch()
            elif name == words.ASKED:
                asked = value
            elif name == words.SOCKET:
                self._note_socket(os.fsdecode(value))
            else:
                self._answers.append(packet)
                if packet == self._device:
                    self._holds = self._answered = True
        if asked:
            # One for all that came: each costs a control step, and a flood must not cost promises.
            number, _, by = asked.partition(b" ")
            self._on_stop(int(number), by.decode())

    def _note_socket(self, found: str) -> None:
        path, why = ("", found.strip()) if found.startswith(" ") else (found, "")
        if why and self.socket != "":
            log.warning("No local socket (%s): %s", why, NO_SOCKET)
        elif path and self.socket == "":
            log.info("The local socket is there again: %s", path)
        self.socket = path

    def _on_readable(self) -> None:
        self._read()
        if self._ended:
            self._replace()

    def _watch(self) -> None:
        if self._loop is not None and self._channel is not None:
            self._loop.add_reader(self._channel, self._on_readable)

    def _unwatch(self) -> None:
        if self._loop is not None and self._channel is not None:
            self._loop.remove_reader(self._channel)

    def _replace(self) -> None:
        self.dismiss()
        self._holds = False
        if not self._renewed:
            return
        # One that never answered would not do so the next time.
        if self._answered:
            self._answered = False
            with contextlib.suppress(OSError):
                self.begin()
                log.warning("The guard has ended, or does not answer: another one was started.")
                self._tell_all()
