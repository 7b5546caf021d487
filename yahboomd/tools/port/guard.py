"""The guard: a process that stops the wheels of whatever drove them, and no longer can.

`yahboomd run`, `setup` and `tune` start it. It is small, and in a session of its own, so that
neither a terminal nor a signal to its owner's job reaches it. Its decisions are those of
:mod:`yahboomd.tools.port.guard_law`; here they are carried out.

It runs as a script with the standard library alone, and imports the rest after its first stop.
"""

from __future__ import annotations

import contextlib
import errno
import os
import select
import signal
import sys
import time
from collections.abc import Iterator
from itertools import chain, count
from typing import TYPE_CHECKING

if __name__ == "__main__":
    # Without `site` Python finds the standard library only.
    sys.path += sys.argv[2].split(os.pathsep)

from yahboomd.core.link import port_note
from yahboomd.core.link.port_note import PortNote
from yahboomd.core.link.seize import Seized, stop_again
from yahboomd.tools.port import guard_law as law
from yahboomd.tools.port.charge import ANSWER, Charge
from yahboomd.tools.stop import last_stop

if TYPE_CHECKING:
    from yahboomd.core.link.takeover import TakeoverReport

KILLED = (
    "yahboomd (pid {pid}) was frozen or starved for {lease:g} s, and was killed. To drive, start "
    "it again."
)
ENDED = "yahboomd (pid {pid}) ended and left wheels that may turn."

ASK_S = 1.0
"""The period at which daemons are asked whether they are connected to the device."""

SAID_AFTER_S = (1.0, 10.0)
SAID_EVERY_S = 60.0

FAR_MS = 10**15
"""A promise without an end: the owner is starting, or ending."""

NEVER_MS = 60_000
"""A poll without an end: the longest that poll(2) needs."""

_HELD_BACK = (errno.EAGAIN, errno.EINTR)


class Guard:
    """Carries out the guard's decisions."""

    def __init__(self, charge: Charge) -> None:
        self._charge = charge
        self._limits = law.Limits(kill_after=0 if charge.kills else FAR_MS)
        self._state = law.State()
        self._note: PortNote | None = None
        self._seized: Seized | None = None
        self._data = b""
        self._why = ENDED
        self._trouble: Exception | TakeoverReport | None = None
        self._outcome = ""
        self._over = False
        self._began_s = self._asked_s = 0.0
        self._due_s: Iterator[float] = chain(SAID_AFTER_S, count(SAID_EVERY_S, SAID_EVERY_S))
        self._word_s = next(self._due_s)

    def serve(self) -> None:
        """Guard until the wheels were seen to stand."""
        if self._charge.port >= 0:
            self._take(law.Shared())
        poll = select.poll()
        poll.register(self._charge.messages, select.POLLIN)
        with contextlib.suppress(OSError):
            # A child of the owner may hold the other end of its messages.
            owner = os.pidfd_open(self._charge.owner)
            if os.getppid() == self._charge.owner:
                poll.register(owner, select.POLLIN)
        while not self._over:
            due, now = self._state.due, _now_ms()
            wait_ms = NEVER_MS if due is None else max(0, min(NEVER_MS, due - now))
            if self._state.owner == "ended":
                time.sleep(wait_ms / 1000.0)
            elif poll.poll(wait_ms):
                self._hear()
            if not self._over:
                self._take(law.Tick())
                self._tell()

    # What the owner says.

    def _hear(self) -> None:
        """Take its messages; without any, it has ended, or leaves its wheels to the guard."""
        poll = select.poll()
        poll.register(self._charge.messages, select.POLLIN)
        data = os.read(self._charge.messages, 4096) if poll.poll(0) else b""
        if not data:
            self._began_s = self._asked_s = time.monotonic()
            self._take(law.Ended())
            return
        *lines, self._data = (self._data + data).split(b"\n")
        for line in lines:
            self._read(*line.partition(b"=")[::2])

    def _read(self, name: bytes, value: bytes) -> None:
        state = self._state
        if name == b"PORT":
            self._note = port_note.note_of(value)
            if not state.turning:
                self._take(law.Renewed(FAR_MS))
        elif name in {b"READY", b"WATCHDOG"}:
            self._take(law.Acknowledged(state.stop))
            self._take(law.Renewed(_now_ms() + round(1000.0 * self._charge.lease_s)))
        elif name == b"STOPPING" and state.turning:
            self._take(law.Renewed(FAR_MS))
        elif name == b"STANDING":
            self._take(law.Standing())
        elif name == b"LOST":
            self._take(law.CloseAsked())
            self._began_s = self._asked_s = time.monotonic()
            self._take(law.Ended())

    # What the machine decides.

    def _take(self, event: law.Event) -> None:
        self._state, actions = law.step(self._state, event, _now_ms(), self._limits)
        for action in actions:
            answer = self._carry_out(action)
            if answer is not None:
                self._take(answer)
            if isinstance(answer, law.Gone):
                break

    def _carry_out(self, action: law.Action) -> law.Event | None:
        if action == "answer":
            os.write(1, ANSWER)
        elif action in {"send zero", "send surest"}:
            return self._send()
        elif action == "open":
            return self._open()
        elif action == "look":
            return self._look()
        elif action == "close":
            self._close()
        elif action == "kill":
            if os.getppid() == self._charge.owner:
                # While it is the parent, its id cannot belong to another process.
                os.kill(self._charge.owner, signal.SIGKILL)
                self._why = KILLED
        else:
            self._end()
        return None

    @property
    def _fd(self) -> int:
        return self._charge.port if self._seized is None else self._seized.fd

    def _send(self) -> law.Event | None:
        try:
            os.write(self._fd, bytes.fromhex(self._charge.stop))
        except OSError as error:
            self._trouble = error
            return None if error.errno in _HELD_BACK else law.Gone()
        return None

    def _open(self) -> law.Event:
        if self._note is None:
            # It had no port.
            return law.Looked(stand=True)
        try:
            self._seized = last_stop.seize_again(self._note)
        except OSError as error:
            self._trouble = error
        else:
            return law.Opened(ours=True)
        if time.monotonic() - self._asked_s >= ASK_S:
            self._asked_s = time.monotonic()
            if words := last_stop.connected_daemon(last_stop.path_of(self._note)):
                self._outcome = words
                return law.Relieved()
        return law.Opened(ours=False)

    def _look(self) -> law.Event:
        note = self._note
        assert note is not None
        if self._seized is None:
            self._seized = Seized(self._fd, note.path, note.baudrate, time.monotonic_ns())
        if self._why:
            self._say(f"{self._explained_why()} A stop was sent.")
            self._why = ""
        try:
            stop_again(self._seized)
        except OSError as error:
            self._trouble = error
            if error.errno != errno.ETIMEDOUT:
                return law.Gone()
        try:
            self._trouble = report = last_stop.watched(self._seized)
        except Exception as error:  # noqa: BLE001 - whatever fails, stops go on
            self._trouble = error
            return law.Looked(stand=False)
        return law.Looked(stand=report.stood is True)

    def _close(self) -> None:
        """Close the port: while it is open, the kernel gives its name to no other device."""
        with contextlib.suppress(OSError):
            os.close(self._fd)
        self._seized = None
        self._charge = self._charge._replace(port=-1)

    def _end(self) -> None:
        self._over = True
        if self._trouble is not None and not isinstance(self._trouble, Exception):
            from yahboomd.tools.stop.stop_port import describe

            self._outcome = self._outcome or describe(self._trouble)
            if self._trouble.stood:
                port_note.end(self._charge.folder, self._charge.owner)
        if self._outcome:
            self._say(self._outcome)
            with contextlib.suppress(OSError):
                os.write(1, self._outcome.encode())

    # What a person hears.

    def _explained_why(self) -> str:
        return self._why.format(pid=self._charge.owner, lease=self._charge.lease_s)

    def _tell(self) -> None:
        """Say what keeps it from its end."""
        if self._state.owner != "ended" or self._note is None:
            return
        if self._over or time.monotonic() - self._began_s < self._word_s:
            return
        self._word_s = next(self._due_s)
        words = last_stop.unfinished(self._note, self._trouble)
        self._say(f"{self._explained_why()} {words}".lstrip())
        self._why = ""

    def _say(self, words: str) -> None:
        """Print words, unless the owner lives: it says them itself."""
        poll = select.poll()
        poll.register(self._charge.messages, 0)
        if os.getppid() != self._charge.owner or poll.poll(0):
            last_stop.say(words)


def _now_ms() -> int:
    return time.monotonic_ns() // 1_000_000


if __name__ == "__main__":
    # The name by which others are told who holds the port.
    with contextlib.suppress(OSError), open("/proc/self/comm", "w", encoding="ascii") as name:
        name.write("yahboomd-guard")
    last_stop.ignore_signals()
    Guard(Charge.of(sys.argv[1])).serve()
