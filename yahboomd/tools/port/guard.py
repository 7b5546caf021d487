"""A second process that releases the motors if the first one dies or hangs during a pulse.

The board has no timeout: a motor whose pulse is not ended turns for ever. A killed process cannot
end it, so another process watches over each pulse, on the same open port. It stops the wheels of a
process that is killed, or whose port goes away, and ends when it has seen them stand.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import select
import subprocess
import sys
import time
from typing import Self

from yahboomd.core.errors import BoardError
from yahboomd.core.link import port_note
from yahboomd.core.link.port_note import PortNote
from yahboomd.core.link.seize import Seized
from yahboomd.tools.stop import last_stop

OVERDUE_S = 0.6
"""A little longer than a pulse; after it the guard stops the wheels, whatever the tool does."""

READY_WITHIN_S = 10.0
ENDS_WITHIN_S = 2.0
STOP_PERIOD_S = 0.05

ENDED = "A command of yahboomd ended and left wheels that may turn."

BEGINS, ENDS, LOST = b"+", b"-", b"l"

_HELD_BACK = (errno.EAGAIN, errno.EINTR)


class Guard:
    """The guard, as seen from the process that it watches.

    Attributes:
        pulse: A pulse began, and its wheels were not seen to stand yet.
    """

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self._process = process
        self.pulse = False

    @classmethod
    def start(cls, fd: int, stop: bytes, note: PortNote) -> Self:
        """Start a guard.

        Args:
            fd: The open port.
            stop: Bytes that release the motors, from any state of the board's parser.
            note: The device and how its port was opened.

        Raises:
            OSError: The process does not start.
        """
        process = subprocess.Popen(  # noqa: S603 - this module
            [sys.executable, "-m", __name__, str(fd), stop.hex(), port_note.text_of(note)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            pass_fds=(fd,),
            # Protects it from Ctrl-C and from a terminal that hangs up.
            start_new_session=True,
        )
        guard = cls(process)
        assert process.stdout is not None
        if not select.select([process.stdout], [], [], READY_WITHIN_S)[0] or not os.read(
            process.stdout.fileno(), 1
        ):
            guard.dismiss()
            raise OSError("the process that would stop the wheels after a crash does not start")
        return guard

    def mark(self, pulse: bool) -> None:
        """Tell the guard that a pulse begins (True), or that it ended and the wheels stand.

        Raises:
            BoardError: The guard is gone: there must be no pulse.
        """
        self.pulse = pulse
        try:
            self._tell(BEGINS if pulse else ENDS)
        except (OSError, ValueError) as error:
            raise BoardError(
                "The process that lets the motors go after a crash has ended: no motor is turned."
            ) from error

    async def stopped_after_loss(self) -> str:
        """Leave a port that went away to the guard, and wait until that saw the wheels stand.

        Returns:
            The outcome in words; empty if the guard was killed.
        """
        assert self._process.stdout is not None
        with contextlib.suppress(OSError, ValueError):
            self._tell(LOST)
        fd, loop, told = self._process.stdout.fileno(), asyncio.get_running_loop(), asyncio.Event()
        loop.add_reader(fd, told.set)
        try:
            await told.wait()
        finally:
            loop.remove_reader(fd)
        return os.read(fd, 4096).decode()

    def dismiss(self) -> None:
        """End the guard without a stop: a person takes care of the wheels."""
        self._process.kill()
        self.close()

    def close(self, within_s: float = ENDS_WITHIN_S) -> None:
        """End the guard; if a pulse has not ended, it first sees the wheels stand.

        Args:
            within_s: How long that is waited for. The guard goes on without this process.
        """
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(within_s)
        # Tells subprocess not to wait for it.
        self._process.returncode = 0

    def _tell(self, mark: bytes) -> None:
        assert self._process.stdin is not None
        os.write(self._process.stdin.fileno(), mark)


def watch(fd: int, stop: bytes, note: PortNote) -> None:
    """Watch over pulses until standard input ends, or the port goes away in a pulse."""
    last_stop.ignore_signals()
    os.write(1, b"!")
    wait_s: float | None = None
    pulse = lost = False
    while not lost:
        if not select.select([0], [], [], wait_s)[0]:
            # Overdue: stop again and again, until the other process goes on or is gone.
            lost, wait_s = not _send(fd, stop), STOP_PERIOD_S
        elif marks := os.read(0, 64):
            lost = LOST in marks
            if state := marks.replace(LOST, b"")[-1:]:
                pulse, wait_s = state == BEGINS, OVERDUE_S if state == BEGINS else None
        else:
            break
    if not pulse:
        return
    seized = None
    if not lost and _send(fd, stop):
        seized = Seized(fd, note.path, note.baudrate, time.monotonic_ns())
    else:
        # While it is open, the kernel gives its name to no other device.
        os.close(fd)
    words, _ = last_stop.stop_until_seen(note, ENDED, seized=seized, tell=_say)
    _say(words)
    with contextlib.suppress(OSError):
        os.write(1, words.encode())


def _send(fd: int, stop: bytes) -> bool:
    """Send the stop if the port takes it now; returns whether the port is still there."""
    try:
        os.write(fd, stop)
    except OSError as error:
        return error.errno in _HELD_BACK
    return True


def _say(words: str) -> None:
    """Print a line, unless the watched process lives, which says it itself."""
    poll = select.poll()
    poll.register(0, 0)
    if poll.poll(0):
        last_stop.say(words)


if __name__ == "__main__":
    opened = port_note.note_of(sys.argv[3])
    assert opened is not None
    watch(int(sys.argv[1]), bytes.fromhex(sys.argv[2]), opened)
