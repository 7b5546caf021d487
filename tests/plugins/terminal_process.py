"""A command on a real pseudo-terminal, with its screen and the state that it leaves behind.

Import the fixture by name in a conftest.py to have it.
"""

from __future__ import annotations

import asyncio
import fcntl
import os
import re
import struct
import subprocess
import sys
import termios
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from zenoh_fixtures import eventually

# The child makes the terminal its own, so that Ctrl-C becomes a signal; done there, because to run
# code between fork and exec is not safe in a process with Zenoh's threads.
_ADOPT = """
import fcntl, os, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
"""

_LAST = b"\0"

_ESCAPES = re.compile(r"\x1b(\[[0-9;?]*[A-Za-z]|[()][A-Z0-9])")


class TerminalProcess:
    """The process, its terminal, and everything that it wrote."""

    def __init__(self, arguments: tuple[str, ...], folder: Path, columns: int, lines: int) -> None:
        self._master, self._slave = os.openpty()
        size = struct.pack("HHHH", lines, columns, 0, 0)
        fcntl.ioctl(self._slave, termios.TIOCSWINSZ, size)
        self.before = termios.tcgetattr(self._slave)
        self._written = bytearray()
        self._open = True
        environ = {key: value for key, value in os.environ.items() if "YAHBOOMD_" not in key}
        self.process = subprocess.Popen(
            [sys.executable, "-S", "-E", "-c", _ADOPT, *arguments],
            stdin=self._slave,
            stdout=self._slave,
            stderr=self._slave,
            cwd=folder,
            env={**environ, "TERM": "xterm-256color", "COLUMNS": "", "LINES": ""},
            start_new_session=True,
        )
        asyncio.get_running_loop().add_reader(self._master, self._read)

    def _read(self) -> None:
        self._written += os.read(self._master, 65536)

    @property
    def written(self) -> str:
        """All of it, escape sequences included."""
        return self._written.decode("utf-8", "replace")

    @property
    def screen(self) -> str:
        """The text of the newest screen that is all there."""
        frames = self.written.split("\x1b[H")
        return _ESCAPES.sub("", frames[-1] if len(frames) < 2 else "\n".join(frames[-2:]))

    def type(self, keys: str) -> None:
        """Press keys."""
        os.write(self._master, keys.encode())

    async def shows(self, words: str) -> None:
        """Wait until the screen, or the output without one, holds some words."""
        await eventually(lambda: words in self.screen or self.process.poll() is not None)
        if words not in self.screen:
            # Its last output may still be on the way.
            await self.ended()
        assert words in self.screen, self.screen

    async def ended(self) -> int:
        """Wait until it has ended, and all that it wrote was read; its status."""
        await eventually(lambda: self.process.poll() is not None)
        if self._open:
            # This comes after everything that the process wrote.
            os.write(self._slave, _LAST)
            await eventually(lambda: self._written.endswith(_LAST))
            self._written = self._written.removesuffix(_LAST)
        status: int = self.process.returncode
        return status

    @property
    def restored(self) -> bool:
        """Whether the terminal is as it was: its modes, its screen, its cursor."""
        written = self.written
        return (
            termios.tcgetattr(self._slave) == self.before
            and written.rfind("\x1b[?1049l") > written.rfind("\x1b[?1049h")
            and written.rfind("\x1b[?25h") > written.rfind("\x1b[?25l")
        )

    def hang_up(self) -> None:
        """Close the window."""
        asyncio.get_running_loop().remove_reader(self._master)
        os.close(self._slave)
        os.close(self._master)
        self._open = False

    def close(self) -> None:
        """End it, if it has not, and let go of the terminal."""
        self.process.kill()
        self.process.wait()
        if self._open:
            self.hang_up()


@pytest.fixture
async def terminal(tmp_path: Path) -> Iterator[Callable[..., TerminalProcess]]:
    """Starts commands: ``terminal("drive", "--linear", "0.2")``; ``code=`` runs that instead."""
    processes: list[TerminalProcess] = []

    def start(*arguments: str, code: str = "", columns: int = 80, lines: int = 24) -> Any:
        words = ("-c", code) if code else ("-W", "error", "-m", "yahboomd", *arguments)
        processes.append(TerminalProcess(words, tmp_path, columns, lines))
        return processes[-1]

    yield start
    for each in processes:
        each.close()
