"""The guard of a tool that turns wheels without a daemon, as the tool sees it."""

from __future__ import annotations

import asyncio
import contextlib
import os
import select
import subprocess
from typing import Self

from yahboomd.core.errors import BoardError
from yahboomd.core.link import port_note
from yahboomd.core.link.port_note import PortNote
from yahboomd.tools.port import charge
from yahboomd.tools.port.charge import ANSWER

LEASE_S = 0.6
"""A little longer than a pulse; after it the guard stops the wheels, whatever the tool does."""

READY_WITHIN_S = 10.0
ENDS_WITHIN_S = 2.0


class ToolGuard:
    """A guard on the tool's own open port, which it shares."""

    def __init__(self, process: subprocess.Popen[bytes], messages: int) -> None:
        self._process = process
        self._messages = messages

    @classmethod
    def start(cls, fd: int, stop: bytes, note: PortNote) -> Self:
        """Start a guard.

        Args:
            fd: The open port.
            stop: Bytes that stop the wheels, from any state of the board's parser.
            note: The device and how its port was opened.

        Raises:
            OSError: The process does not start.
        """
        guard = cls(*charge.start(LEASE_S, port=fd, stop=stop))
        process = guard._process
        assert process.stdout is not None
        if not select.select([process.stdout], [], [], READY_WITHIN_S)[0] or not os.read(
            process.stdout.fileno(), len(ANSWER)
        ):
            guard.dismiss()
            raise OSError("the process that would stop the wheels after a crash does not start")
        guard._tell(f"PORT={port_note.text_of(note)}\nSTANDING=1")
        return guard

    def mark(self, turning: bool) -> None:
        """Tell the guard that wheels are about to be driven (True), or were seen to stand.

        Raises:
            BoardError: The guard is gone: no wheel must be driven.
        """
        try:
            self._tell("WATCHDOG=1" if turning else "STANDING=1")
        except OSError as error:
            raise BoardError(
                "The process that stops the wheels after a crash has ended: no motor is turned."
            ) from error

    async def stopped_after_loss(self) -> str:
        """Leave a port that went away to the guard, and wait until that saw the wheels stand.

        Returns:
            The outcome in words; empty if the guard was killed.
        """
        assert self._process.stdout is not None
        with contextlib.suppress(OSError):
            self._tell("LOST=1")
        fd, loop, told = self._process.stdout.fileno(), asyncio.get_running_loop(), asyncio.Event()
        loop.add_reader(fd, told.set)
        try:
            while True:
                await told.wait()
                told.clear()
                data = os.read(fd, 4096)
                if (words := data.strip(ANSWER)) or not data:
                    return words.decode()
        finally:
            loop.remove_reader(fd)

    def dismiss(self) -> None:
        """End the guard without a stop: a person takes care of the wheels."""
        self._process.kill()
        self.close()

    def close(self, within_s: float = ENDS_WITHIN_S) -> None:
        """End the guard; if the wheels may turn, it first sees them stand.

        Args:
            within_s: How long that is waited for. The guard goes on without this process.
        """
        assert self._process.stdout is not None
        self._process.stdout.close()
        messages, self._messages = self._messages, -1
        if messages >= 0:
            os.close(messages)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(within_s)
        # Tells subprocess not to wait for it.
        self._process.returncode = 0

    def _tell(self, message: str) -> None:
        os.write(self._messages, f"{message}\n".encode())
