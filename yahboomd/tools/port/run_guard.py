"""The guard of `yahboomd run`: replaces the service's watchdog if no service manager runs it.

It is a small process in a session of its own, so that neither a terminal nor a signal to the
daemon's job reaches it. It kills a daemon whose beats end. It stops the wheels of a daemon that
ended while they may turn: it takes the daemon's device, as `yahboomd stop --direct` does. Until
then it opens no port.

It runs as a script with the standard library alone, and imports the rest after its first stop.
"""

from __future__ import annotations

import os
import select
import signal
import sys
import time
from typing import TYPE_CHECKING

if __name__ == "__main__":
    # Without `site` Python finds the standard library only.
    sys.path += sys.argv[4].split(os.pathsep)

from yahboomd.core.link import port_note
from yahboomd.core.link.port_note import PortNote
from yahboomd.tools.stop import replug

if TYPE_CHECKING:
    from yahboomd.core.link.seize import Seized
    from yahboomd.core.link.takeover import TakeoverReport

BEATS_WITHIN_S = 2.0
"""The same time as the unit's watchdog."""

GRACE_S = 0.5
"""If the guard itself did not run, as when the whole machine stood still, it waits once more."""

LATE_S = 0.2
KILLED = (
    f"yahboomd (pid {{pid}}) was frozen or starved for {BEATS_WITHIN_S:g} s, and was killed. To "
    "drive, start it again."
)
ENDED = "yahboomd (pid {pid}) ended and left wheels that may turn."

BACK_WITHIN_S = 60.0
"""The time for which it looks for a board that is not there."""

MISSING_S = 1.0
SAID_WITHIN_S = 0.2


class Watch:
    """Reads the daemon's messages: those of sd_notify(3), and two more.

    Attributes:
        beats: The daemon has to beat now.
        standing: The daemon left standing wheels, or drove none.
        note: Its open port.
    """

    def __init__(self) -> None:
        self.beats = False
        self.standing = True
        self.note: PortNote | None = None
        self._data = b""

    def read(self, data: bytes) -> None:
        """Read a piece of the messages."""
        *lines, self._data = (self._data + data).split(b"\n")
        for line in lines:
            name, _, value = line.partition(b"=")
            if name == b"PORT":
                self.note, self.standing = port_note.note_of(value), False
            elif name in {b"READY", b"WATCHDOG"}:
                self.beats, self.standing = True, self.note is None
            elif name in {b"STOPPING", b"STANDING"}:
                self.beats = False
                self.standing = self.standing or name == b"STANDING"


def guard(fd: int, daemon: int, folder: str) -> None:
    """Watch a daemon until it ends, and stop the wheels that it leaves turning.

    Args:
        fd: Delivers the daemon's messages until it ends.
        daemon: The daemon's process, the parent of this one.
        folder: Its runtime folder.
    """
    for number in signal.valid_signals() - {signal.SIGKILL, signal.SIGSTOP, signal.SIGCHLD}:
        # A signal that ends a service or a session ends the daemon, and then this process acts.
        signal.signal(number, signal.SIG_IGN)
    watch = Watch()
    killed = _until_ended(fd, daemon, watch)
    if watch.note is None or watch.standing:
        return
    report = _stop(watch.note, KILLED if killed else ENDED, daemon)
    if report is None:
        return
    from yahboomd.tools.stop.stop_port import describe

    say(describe(report))
    if report.stood:
        port_note.end(folder, daemon)


def _until_ended(fd: int, daemon: int, watch: Watch) -> bool:
    """Wait until the daemon has ended; returns whether this guard killed it."""
    poll = select.poll()
    poll.register(fd, select.POLLIN)
    due_s: float | None = None
    killed = again = False
    while True:
        wait_s = None if due_s is None else max(0.0, due_s - time.monotonic())
        if poll.poll(None if wait_s is None else 1000 * wait_s + 1):
            if not (data := os.read(fd, 4096)):
                return killed
            watch.read(data)
            again = False
            due_s = time.monotonic() + BEATS_WITHIN_S if watch.beats and not killed else None
        elif due_s is not None:
            now_s = time.monotonic()
            if now_s - due_s > LATE_S and not again:
                again, due_s = True, now_s + GRACE_S
            elif os.getppid() == daemon:
                # While the daemon is the parent, its id cannot belong to another process.
                os.kill(daemon, signal.SIGKILL)
                killed, due_s = True, None
            else:
                due_s = None


def _stop(note: PortNote, why: str, daemon: int) -> TakeoverReport | None:
    """Take the device and stop its wheels; None after a message that it could not be taken."""
    began_s = time.monotonic()
    asked = False
    why = why.format(pid=daemon)
    while (passed_s := time.monotonic() - began_s) < BACK_WITHIN_S:
        try:
            seized = replug.seize_again(note)
        except replug.TakenByOurs as taker:
            say(f"{why} {taker} now, and stops the wheels as it begins.")
            return None
        # seize_again() has sent the first stop already: words come second.
        if why and seized is not None:
            say(f"{why} A stop was sent.")
            why = ""
        if seized is not None and (report := _taken_over(seized)) is not None:
            return report
        if passed_s >= MISSING_S and not asked:
            asked = True
            say(
                f"{why} {note.path} cannot be taken, so the wheels may turn on. Plug the board in "
                "again, or switch the motors' supply off. If it can be taken within a minute, the "
                "wheels are stopped.".lstrip()
            )
            why = ""
        time.sleep(replug.LOOK_S)
    say(
        f"{note.path} could not be taken: the wheels may still turn. Switch the motors' supply "
        "off, or run `yahboomd stop` once the board is back."
    )
    return None


def _taken_over(seized: Seized) -> TakeoverReport | None:
    """Wait until the wheels stand; None if the port went away again."""
    # Imported after the first stop, because the imports take longer than the stop.
    import asyncio

    from yahboomd.core.clock import SystemClock
    from yahboomd.core.errors import LinkError
    from yahboomd.core.link.takeover import take_over_seized

    try:
        return asyncio.run(take_over_seized(seized, SystemClock()))
    except LinkError:
        return None


def say(words: str) -> None:
    """Print a line to standard error, unless its reader is gone or accepts nothing."""
    from yahboomd.core.program import pasteable, readable

    poll = select.poll()
    poll.register(2, select.POLLOUT)
    try:
        if not poll.poll(1000 * SAID_WITHIN_S):
            return
        os.write(2, f"yahboomd: {pasteable(readable(words))}\n".encode())
    except OSError:
        return


if __name__ == "__main__":
    guard(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3])
