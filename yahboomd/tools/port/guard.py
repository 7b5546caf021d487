"""A second process that releases the motors if the first one dies or hangs during a pulse.

The board has no timeout: a motor whose pulse is not ended turns for ever. A killed process cannot
end it, so another process watches over each pulse, on the same open port. If the port is gone by
then, that process waits up to a minute for the board, and stops it once.
"""

from __future__ import annotations

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
from yahboomd.tools.stop import replug

OVERDUE_S = 0.6
"""A little longer than a pulse; after it the guard stops the wheels, whatever the tool does."""

READY_WITHIN_S = 10.0
ENDS_WITHIN_S = 2.0
STOPS = 20
STOP_PERIOD_S = 0.05

BACK_WITHIN_S = 60.0
"""The time for which the guard looks for a board that went away in a pulse."""

BEGINS, ENDS, LOST, DISMISSED = b"+", b"-", b"l", b"."

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
    def start(cls, fd: int, stop: bytes, note: PortNote | None = None) -> Self:
        """Start a guard.

        Args:
            fd: The open port.
            stop: Bytes that release the motors, from any state of the board's parser.
            note: The device and how its port was opened; None: do not look for the device.

        Raises:
            OSError: The process does not start.
        """
        process = subprocess.Popen(  # noqa: S603 - this module
            [sys.executable, "-m", __name__, str(fd), stop.hex(), port_note.text_of(note)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            pass_fds=(fd,),
            # Protects it from Ctrl-C and from a terminal that hangs up.
            start_new_session=True,
        )
        guard = cls(process)
        assert process.stdout is not None
        if not select.select([process.stdout], [], [], READY_WITHIN_S)[0] or not os.read(
            process.stdout.fileno(), 1
        ):
            guard.close()
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

    def lose_port(self) -> None:
        """Have the guard close a port that went away, so that the kernel can reuse its name."""
        self._try_to_tell(LOST)

    def dismiss(self) -> None:
        """End the guard without a stop: the wheels stand, or a person takes care of them."""
        self._try_to_tell(DISMISSED)
        self.close()

    def leave(self) -> None:
        """Leave the guard running; it acts as if this process was killed."""
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()
        # Tells subprocess not to wait for it.
        self._process.returncode = 0

    def _tell(self, mark: bytes) -> None:
        assert self._process.stdin is not None
        os.write(self._process.stdin.fileno(), mark)

    def _try_to_tell(self, mark: bytes) -> None:
        with contextlib.suppress(OSError, ValueError):
            self._tell(mark)

    def close(self) -> None:
        """End the guard, which first stops the wheels if a pulse has not ended."""
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()
        try:
            self._process.wait(ENDS_WITHIN_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def watch(fd: int, stop: bytes, note: PortNote | None = None) -> None:
    """Watch over pulses until standard input ends."""
    os.write(1, b"!")
    wait_s: float | None = None
    lost = pulse = False
    while True:
        if not select.select([0], [], [], wait_s)[0]:
            # Overdue: stop again and again, until the other process goes on or is gone.
            lost, wait_s = not _send(fd, stop), STOP_PERIOD_S
        elif marks := os.read(0, 64):
            if DISMISSED in marks:
                return
            lost = lost or LOST in marks
            if state := marks.replace(LOST, b"")[-1:]:
                pulse, wait_s = state == BEGINS, OVERDUE_S if state == BEGINS else None
        else:
            break
        if lost:
            fd, wait_s = _closed(fd), None
    for _ in range(STOPS if pulse and not lost else 0):
        if lost := not _send(fd, stop):
            break
        select.select([], [], [], STOP_PERIOD_S)
    if pulse and lost and note is not None:
        _closed(fd)
        _stop_when_back(note)


def _send(fd: int, stop: bytes) -> bool:
    """Send the stop if the port takes it now; returns whether the port is still there."""
    try:
        os.write(fd, stop)
    except OSError as error:
        return error.errno in _HELD_BACK
    return True


def _closed(fd: int) -> int:
    """Close the port: while it is open, the kernel gives its name to no other device."""
    if fd >= 0:
        with contextlib.suppress(OSError):
            os.close(fd)
    return -1


def _stop_when_back(note: PortNote) -> None:
    until_s = time.monotonic() + BACK_WITHIN_S
    while time.monotonic() < until_s:
        try:
            seized = replug.seize_again(note)
        except replug.TakenByOurs:
            return
        if seized is not None:
            # Imported after the first stop, because the import takes longer than the stop.
            import asyncio

            from yahboomd.core.clock import SystemClock
            from yahboomd.core.errors import LinkError
            from yahboomd.core.link.takeover import take_over_seized

            with contextlib.suppress(LinkError):
                asyncio.run(take_over_seized(seized, SystemClock()))
                return
        select.select([], [], [], replug.LOOK_S)


if __name__ == "__main__":
    watch(int(sys.argv[1]), bytes.fromhex(sys.argv[2]), port_note.note_of(sys.argv[3]))
