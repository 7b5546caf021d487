"""A second process that lets the motors go where the first one dies, or hangs, in a pulse.

The board has no timeout: a motor whose pulse is not ended turns for ever. No code of a process that
was killed ends it, so another process watches over each pulse, on the same open port.
"""

from __future__ import annotations

import os
import select
import subprocess
import sys
from typing import Self

from yahboomd.errors import BoardError

OVERDUE_S = 0.6
"""A little more than a pulse: then the guard stops the wheels, whatever the other process does."""

READY_WITHIN_S = 10.0
ENDS_WITHIN_S = 2.0
STOPS = 20
STOP_PERIOD_S = 0.05

BEGINS, ENDS = b"+", b"-"


class Guard:
    """The guard, as the process that it watches sees it."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self._process = process

    @classmethod
    def start(cls, fd: int, stop: bytes) -> Self:
        """Start a guard.

        Args:
            fd: Of the port.
            stop: What lets the motors go, from any state of the board's parser.

        Raises:
            OSError: It does not start.
        """
        process = subprocess.Popen(  # noqa: S603 - this module
            [sys.executable, "-m", __name__, str(fd), stop.hex()],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            pass_fds=(fd,),
            # Ctrl-C and a terminal that hangs up are not meant for it.
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
        """A pulse begins (True), or has ended and the wheels stand.

        Raises:
            BoardError: The guard is gone: there must be no pulse.
        """
        assert self._process.stdin is not None
        try:
            os.write(self._process.stdin.fileno(), BEGINS if pulse else ENDS)
        except (OSError, ValueError) as error:
            raise BoardError(
                "The process that lets the motors go after a crash has ended: no motor is turned."
            ) from error

    def close(self) -> None:
        """End it; it stops the wheels first where a pulse has not ended."""
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()
        try:
            self._process.wait(ENDS_WITHIN_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def watch(fd: int, stop: bytes) -> None:
    """Watch over pulses until standard input ends."""
    os.write(1, b"!")
    wait_s: float | None = None
    while True:
        if not select.select([0], [], [], wait_s)[0]:
            # Overdue: again and again, until the other process goes on or is gone.
            _send(fd, stop)
            wait_s = STOP_PERIOD_S
            continue
        marks = os.read(0, 64)
        if not marks:
            break
        wait_s = OVERDUE_S if marks[-1:] == BEGINS else None
    if wait_s is not None:
        for _ in range(STOPS):
            _send(fd, stop)
            select.select([], [], [], STOP_PERIOD_S)


def _send(fd: int, stop: bytes) -> None:
    try:
        os.write(fd, stop)
    except OSError:
        # The port is gone, or takes nothing at this moment.
        return


if __name__ == "__main__":
    watch(int(sys.argv[1]), bytes.fromhex(sys.argv[2]))
