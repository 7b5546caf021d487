"""The guard of `yahboomd run`: replaces the service's watchdog if no service manager runs it.

It is a small process in a session of its own, so that neither a terminal nor a signal to the
daemon's job reaches it. It kills a daemon whose beats end. It stops the wheels of a daemon that
ended while they may turn, and ends when it has seen them stand. Until then it opens no port.

It runs as a script with the standard library alone, and imports the rest after its first stop.
"""

from __future__ import annotations

import os
import select
import signal
import sys
import time

if __name__ == "__main__":
    # Without `site` Python finds the standard library only.
    sys.path += sys.argv[4].split(os.pathsep)

from yahboomd.core.link import port_note
from yahboomd.core.link.port_note import PortNote
from yahboomd.tools.stop import last_stop

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
    last_stop.ignore_signals()
    watch = Watch()
    killed = _until_ended(fd, daemon, watch)
    if watch.note is None or watch.standing:
        return
    why = (KILLED if killed else ENDED).format(pid=daemon)
    words, stood = last_stop.stop_until_seen(watch.note, why)
    last_stop.say(words)
    if stood:
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


if __name__ == "__main__":
    guard(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3])
