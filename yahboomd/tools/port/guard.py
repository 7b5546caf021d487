"""The guard: a process that stops the wheels of whatever drove them, and no longer can.

`yahboomd run`, `setup` and `tune` start it. It is small, and in a session of its own, so that
neither a terminal nor a signal to its owner's job reaches it. Its decisions are those of
:mod:`yahboomd.tools.port.guard_law`; here they are carried out.

It runs as a script with the standard library alone, and imports the rest after its first stop.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import json
import os
import select
import signal
import socket
import sys
import termios
import time
from collections.abc import Iterator
from functools import partial
from itertools import chain, count
from typing import TYPE_CHECKING

if __name__ == "__main__":
    # Without `site` Python finds the standard library only.
    sys.path += sys.argv[2].split(os.pathsep)

from yahboomd.core.link import guard_words as words
from yahboomd.core.link import port_note
from yahboomd.core.link.port_note import PortNote
from yahboomd.core.link.promise import Promise
from yahboomd.core.link.seize import Seized, keep_out, stop_again
from yahboomd.tools.port import guard_law as law
from yahboomd.tools.port.charge import Charge
from yahboomd.tools.port.disk_work import DiskWork
from yahboomd.tools.port.local_stops import LocalStops, MadeSocket, Request
from yahboomd.tools.stop import last_stop
from yahboomd.tools.stop.local_socket import tell_others

if TYPE_CHECKING:
    from yahboomd.core.link.takeover import TakeoverReport

KILLED = (
    "yahboomd (pid {pid}) was frozen or starved for {lapse:g} s, and was killed. To drive, start "
    "it again."
)
ENDED = "yahboomd (pid {pid}) ended and left wheels that may turn."

HUNG = (
    "yahboomd (pid {pid}) does not answer: its guard sent the stop. yahboomd obeys, too, when it "
    "goes on."
)
NOT_SENT = (
    "yahboomd (pid {pid}) does not answer, and its guard could not send the stop yet ({trouble}). "
    "It goes on trying."
)
ENDED_BEFORE = "yahboomd (pid {pid}) has ended; its guard stops the wheels."
NOT_ON_FILE = " It is not on file yet ({}): a restart would release it."
TRYING = "The wheels may turn, and the guard goes on trying: switch the motors' supply off."
RELIEVED = "Another yahboomd (its guard is pid {pid}) has {port} now, and sent its stop."

LATCHED_WITHIN_MS = 500
"""Who asks for an emergency stop waits no longer for a disk."""

SAID_AFTER_S = (1.0, 10.0)
SAID_EVERY_S = 60.0

FAR_MS = 10**15
"""The owner of a tool's guard is not killed: a person ends it."""

NEVER_MS = 60_000
"""A poll without an end: the longest that poll(2) needs."""

_FAILED: dict[law.Action, law.Event] = {
    "open": law.Opened(ours=False),
    "look": law.Looked(stand=False),
}
"""What an action answers that failed in a way that it does not know of, an import perhaps."""

_HELD_BACK = (errno.EAGAIN, errno.EINTR, errno.ETIMEDOUT)


class Guard:
    """Carries out the guard's decisions."""

    def __init__(self, charge: Charge, channel: socket.socket, promise: Promise) -> None:
        self._charge = charge
        self._channel = channel
        self._owner = -1
        self._promise = promise
        self._limits = law.Limits() if charge.kills else law.Limits(kill_after=FAR_MS)
        acknowledged = promise.acknowledged == promise.stop
        asked = promise.asked != promise.obeyed
        self._state = law.begun(promise.stop, acknowledged, asked, _now_ms(), self._limits)
        self._stops = LocalStops(promise.asked)
        self._disk = DiskWork()
        self._others = select.epoll()
        for each in (self._stops, self._disk):
            self._others.register(each, select.EPOLLIN)
        self._blind: Exception | str | None = "its imports wait for the disk"
        self._latching: int | None = None
        self._refused, self._dropped = promise.refused, promise.dropped
        self._listening = words.Listening("", "")
        self._by = "the local socket"
        self._later: Request | None = None
        self._poll = select.poll()
        self._note: PortNote | None = None
        self._has_relay = False
        self._seized: Seized | None = None
        self._brake = self._surest = b""
        self._ended_before = ENDED_BEFORE.format(pid=charge.owner)
        self._why = ENDED
        self._trouble: Exception | TakeoverReport | None = None
        self._outcome = ""
        self._over = False
        self._began_s = 0.0
        self._due_s: Iterator[float] = chain(SAID_AFTER_S, count(SAID_EVERY_S, SAID_EVERY_S))
        self._word_s = next(self._due_s)

    def serve(self) -> None:
        """Guard until the wheels were seen to stand."""
        self._channel.setblocking(False)
        poll = self._poll
        poll.register(self._others, select.POLLIN)
        poll.register(self._channel, select.POLLIN)
        with contextlib.suppress(OSError):
            # A child of the owner may hold the other end of the channel.
            self._owner = os.pidfd_open(self._charge.owner)
            poll.register(self._owner, select.POLLIN)
        while not self._over:
            due, now = self._state.due, _now_ms()
            wait_ms = NEVER_MS if due is None else max(0, min(NEVER_MS, due - now))
            if self._latching is not None:
                wait_ms = min(wait_ms, LATCHED_WITHIN_MS)
            ready = {fd for fd, _ in poll.poll(wait_ms)}
            if self._state.owner != "ended":
                # While it is the parent, its id cannot belong to another process.
                self._hear(ended=self._owner in ready or os.getppid() != self._charge.owner)
            if self._others.fileno() in ready and not self._over:
                self._serve_stops()
            if (later := self._later) is not None and not self._over:
                self._later = None
                self._hand_over(later)
            if not self._over:
                self._take(law.Tick())
                if self._state.owner == "ended" and self._blind is not None:
                    self._disk.do("import", last_stop.prepare, self._prepared)
                self._tell()
            if self._latching is not None and _now_ms() - self._latching >= LATCHED_WITHIN_MS:
                self._latching = None
                self._answer_latched("the disk does not answer")
        # A disk holds up nothing any more.
        if getattr(self._trouble, "stood", False):
            port_note.end(self._charge.folder, self._charge.owner, killed=True)
        self._stops.close()

    # What the owner says.

    def _hear(self, *, ended: bool) -> None:
        """Take what it said; then its end, or that it leaves its wheels to the guard."""
        while True:
            try:
                message, fds, flags, _ = socket.recv_fds(self._channel, words.MAX_BYTES, 1)
            except BlockingIOError:
                break
            except ConnectionResetError:
                # It left an answer unread; what it said before is still there.
                continue
            if not message:
                ended = True
                break
            if flags & socket.MSG_CTRUNC:
                # Without a free descriptor the kernel drops the owner's.
                self._say_to_owner(b"0")
            self._read(*message.partition(b" ")[::2], *fds)
        self._read_promise()
        if ended:
            if self._seized is not None:
                self._seized = self._seized._replace(spoken_ns=time.monotonic_ns())
            self._began_s = time.monotonic()
            for fd in (self._channel.fileno(), self._owner):
                with contextlib.suppress(KeyError, ValueError):
                    self._poll.unregister(fd)
            facts = json.loads(self._stops.facts)
            facts |= {"connected": False, "state": "ended", "why": self._ended_before}
            self._stops.facts = json.dumps(facts).encode()
            self._take(law.Ended())

    def _read(self, name: bytes, value: bytes, fd: int | None = None) -> None:
        if name == words.PORT:
            self._note = note = port_note.note_of(value)
            if note is not None and fd is not None:
                self._close()
                self._seized = Seized(fd, note.path, note.baudrate, time.monotonic_ns())
                self._brake = self._surest = b""
                self._take(law.Shared())
                if note.relay and not self._has_relay:
                    from yahboomd.tools.port import relay

                    self._has_relay = True
                    relay.start(note.relay, self._heard_ms)
        elif name == words.STOP:
            self._brake, self._surest = (bytes.fromhex(each.decode()) for each in value.split())
            self._tell_held()
        elif name == words.CLOSE:
            self._take(law.CloseAsked())
        elif name == words.LISTEN:
            self._listening = words.Listening(*json.loads(value))
            made = partial(self._stops.made, self._listening.folder, self._listening.name)
            self._disk.do("listen", made, self._listen)
            # Again and again: a guard that missed it would stop this owner's wheels.
            self._tell_held()
        elif name == words.PROMISE:
            self._promise.read = int(value)
        elif name == words.FACTS:
            self._stops.facts = value
        elif name in {words.ANSWERED, words.SEEN}:
            number, _, line = value.partition(b" ")
            tell = self._stops.answer if name == words.ANSWERED else self._stops.finish
            tell(int(number), line)
        elif name == words.WANTED:
            self._tell_others(words.NEXT, int(value))

    def _listen(self, made: MadeSocket | Exception | None) -> None:
        if isinstance(made, MadeSocket):
            self._stops.listen(*made)
        path = f" {made}" if isinstance(made, Exception) else self._stops.path
        self._say_to_owner(b"%s %s" % (words.SOCKET, os.fsencode(path)))

    def _tell_held(self) -> None:
        """Tell the guard of a dead owner that this one has its device, and sent its stop."""
        if self._seized is not None and self._surest:
            self._tell_others(words.HELD, os.fstat(self._seized.fd).st_rdev)

    def _tell_others(self, verb: bytes, device: int) -> None:
        own, folder = self._stops.path, self._listening.folder
        self._disk.do(verb.decode(), partial(tell_others, folder, own, verb, device))

    def _heard_ms(self) -> int | None:
        return None if self._seized is None else self._promise.heard_ms

    def _read_promise(self) -> None:
        # The owner renews its promise before it acknowledges a stop.
        acknowledged, until_ms = self._promise.acknowledged, self._promise.until_ms
        state = self._state
        if until_ms and (until_ms != state.until or not state.turning):
            self._take(law.Renewed(until_ms))
        elif state.turning and not until_ms:
            self._take(law.Standing())
        if state.asked is not None and self._promise.obeyed == self._promise.asked:
            self._take(law.Obeyed())
        if not state.acknowledged:
            self._take(law.Acknowledged(acknowledged))

    # What other programs ask for.

    def _serve_stops(self, *, looking: bool = False) -> None:
        """Take the requests of other programs, and what the disk has done.

        Args:
            looking: The wheels are watched: the next owner asks again after that.
        """
        self._disk.take()
        for request in self._stops.take():
            if request.by:
                self._by = request.by
                self._promise.asked = request.number
                self._say_to_owner(b"%s %d %s" % (words.ASKED, request.number, request.by.encode()))
                if not self._charge.kills:
                    # A suspended tool ends only once it goes on.
                    with contextlib.suppress(OSError):
                        signal.pidfd_send_signal(self._owner, signal.SIGCONT)
                self._take(law.Asked())
            elif looking:
                self._later = request
            else:
                self._hand_over(request)
        counters = self._stops.counters
        self._promise.refused = self._refused + counters["refused"]
        self._promise.dropped = self._dropped + counters["dropped"]

    def _hand_over(self, request: Request) -> None:
        """Let the next owner of the same device have the port; end once it has sent its stop."""
        note, is_ours = self._note, False
        with contextlib.suppress(OSError):
            path = "" if note is None else last_stop.path_of(note)
            is_ours = path != "" and os.stat(path).st_rdev == request.device
        if not is_ours or note is None:
            return
        if request.verb == words.NEXT:
            self._take(law.Wanted())
        elif self._state.owner == "ended" and not self._locks():
            self._outcome = RELIEVED.format(pid=request.pid, port=note.path)
            self._finish(stood=None)
            self._take(law.Relieved())

    def _locks(self) -> bool:
        """Whether no other process has locked its port; it is locked then."""
        if self._seized is None:
            return False
        try:
            fcntl.flock(self._seized.fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
            keep_out(self._seized.fd)
        except OSError:
            return False
        return True

    def _latch(self) -> None:
        self._latching = self._latching or _now_ms()
        job = partial(_put_on_file, self._listening.latch, self._by)
        self._disk.do("latch", job, self._latched)

    def _latched(self, trouble: Exception | None) -> None:
        self._latching = None
        self._answer_latched(trouble)
        self._take(law.Latched())

    def _answer_latched(self, trouble: Exception | str | None) -> None:
        sentence = self._ended_before
        if self._listening.latch:
            sentence = f"Emergency stop engaged by {self._by}. {sentence}"
            if trouble is not None:
                sentence += NOT_ON_FILE.format(trouble)
        self._answer(sentence, sent=self._seized is not None or not self._state.turning)

    def _answer_for_owner(self) -> None:
        """Answer a request that the owner does not obey."""
        if self._state.asked is not None and self._state.owner != "ended":
            sent = self._trouble is None
            words_ = HUNG if sent else NOT_SENT
            self._answer(words_.format(pid=self._charge.owner, trouble=self._trouble), sent=sent)

    def _finish(self, *, stood: bool | None) -> None:
        # A request that the owner left unanswered.
        self._answer(self._ended_before, sent=True)
        seen = {"stood": stood, "fastest_m_s": 0.0 if stood else None, "why": self._outcome}
        self._stops.finish(self._promise.asked, json.dumps(seen).encode())

    def _answer(self, sentence: str, *, sent: bool) -> None:
        line = {"engaged": True, "sent": sent, "message": sentence}
        self._stops.answer(self._promise.asked, json.dumps(line).encode())

    # What the machine decides.

    def _take(self, event: law.Event) -> None:
        self._state, actions = law.step(self._state, event, _now_ms(), self._limits)
        # The owner knows of a stop before that is on the wire.
        self._promise.stop = self._state.stop
        for action in actions:
            try:
                answer = self._carry_out(action)
            except Exception as error:  # noqa: BLE001 - whatever fails, stops go on
                self._trouble = error
                answer = _FAILED.get(action)
            if answer is not None:
                self._take(answer)
            if isinstance(answer, law.Gone):
                break

    def _carry_out(self, action: law.Action) -> law.Event | None:
        if action == "answer":
            seized = self._seized
            self._say_to_owner(
                words.CLOSED if seized is None else b"%d" % os.fstat(seized.fd).st_rdev
            )
        elif action in {"send zero", "send surest"}:
            return self._send(self._brake if action == "send zero" else self._surest)
        elif action == "open":
            return self._open()
        elif action == "look":
            return self._look()
        elif action == "latch":
            self._latch()
        elif action == "unlock":
            assert self._seized is not None
            with contextlib.suppress(OSError):
                fcntl.flock(self._seized.fd, fcntl.LOCK_UN)
                fcntl.ioctl(self._seized.fd, termios.TIOCNXCL)
        elif action == "close":
            self._close()
        elif action == "kill":
            with contextlib.suppress(OSError):
                signal.pidfd_send_signal(self._owner, signal.SIGKILL)
                self._why = KILLED
        else:
            self._end()
        return None

    def _send(self, frames: bytes) -> law.Event | None:
        assert self._seized is not None
        self._trouble = gone = None
        try:
            with contextlib.suppress(termios.error):
                # Any program may have suspended its output.
                termios.tcflow(self._seized.fd, termios.TCOON)
            if frames:
                os.write(self._seized.fd, self._surest if self._promise.let_go else frames)
            else:
                stop_again(self._seized)
        except OSError as error:
            self._trouble = error
            gone = None if error.errno in _HELD_BACK else law.Gone()
        self._answer_for_owner()
        return gone

    def _open(self) -> law.Event:
        if self._note is None and self._state.owner == "ended":
            # It had no port.
            return law.Looked(stand=True)
        self._trouble = None
        try:
            self._seized = last_stop.seize_again(self._note)
        except OSError as error:
            self._trouble = error
        self._answer_for_owner()
        return law.Opened(ours=self._trouble is None)

    def _look(self) -> law.Event:
        assert self._seized is not None
        if self._blind is not None:
            return self._send(self._surest) or law.Looked(stand=False)
        if self._why:
            why, self._why = self._explained_why(), ""
            self._say(f"{why} A stop was sent.")
        if not self._locks():
            # The next owner has it, and did not say yet that it sent its stop.
            return self._send(self._surest) or law.Looked(stand=False)
        try:
            stop_again(self._seized)
        except OSError as error:
            self._trouble = error
            if error.errno != errno.ETIMEDOUT:
                return law.Gone()
        try:
            attend = partial(self._serve_stops, looking=True)
            self._trouble = report = last_stop.watched(self._seized, self._others.fileno(), attend)
        except Exception as error:  # noqa: BLE001 - whatever fails, stops go on
            self._trouble = error
            return law.Looked(stand=False)
        return law.Looked(stand=report.stood is True)

    def _prepared(self, error: Exception | None) -> None:
        self._blind = error

    def _close(self) -> None:
        """Close the port: while it is open, the kernel gives its name to no other device."""
        seized, self._seized = self._seized, None
        if seized is not None:
            with contextlib.suppress(OSError):
                os.close(seized.fd)

    def _end(self) -> None:
        self._over = True
        if self._trouble is not None and not isinstance(self._trouble, Exception):
            from yahboomd.tools.stop.stop_port import describe

            self._outcome = self._outcome or describe(self._trouble)
        if self._outcome:
            self._say(self._outcome)
            self._say_to_owner(self._outcome.encode())
        self._finish(stood=True)

    # What a person hears.

    def _explained_why(self) -> str:
        return self._why.format(pid=self._charge.owner, lapse=self._limits.kill_after / 1000.0)

    def _tell(self) -> None:
        """Say what keeps it from its end."""
        if self._state.owner != "ended" or self._note is None:
            return
        if self._over or time.monotonic() - self._began_s < self._word_s:
            return
        self._word_s = next(self._due_s)
        why, self._why = self._explained_why(), ""
        if self._blind is None:
            self._say(f"{why} {last_stop.unfinished(self._note, self._trouble)}".lstrip())
        else:
            last_stop.write(f"{why} {TRYING} ({self._blind})".lstrip())

    def _say(self, sentence: str) -> None:
        """Print words, unless the owner lives: it says them itself."""
        poll = select.poll()
        poll.register(self._channel, 0)
        if os.getppid() != self._charge.owner or poll.poll(0):
            last_stop.say(sentence)

    def _say_to_owner(self, answer: bytes) -> None:
        with contextlib.suppress(OSError):
            self._channel.send(answer)


def _put_on_file(path: str, by: str) -> None:
    """Engage the emergency stop on file; the disk may hold it up."""
    if path:
        from pathlib import Path

        from yahboomd.core.daemon.estop.latch_file import LatchFile

        LatchFile(Path(path)).engage(by)


def _now_ms() -> int:
    return time.monotonic_ns() // 1_000_000


if __name__ == "__main__":
    # The name by which others are told who holds the port.
    with contextlib.suppress(OSError), open("/proc/self/comm", "w", encoding="ascii") as name:
        name.write("yahboomd-guard")
    last_stop.ignore_signals()
    _charge = Charge.of(sys.argv[1])
    Guard(_charge, socket.socket(fileno=_charge.channel), Promise(_charge.promise)).serve()
