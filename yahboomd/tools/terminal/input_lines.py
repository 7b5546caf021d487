"""Reads lines of standard input while the loop runs on."""

from __future__ import annotations

import asyncio
import os
import sys
import termios


class InputLines:
    """Lines of standard input, read without blocking the loop.

    Args:
        longest: A line of more bytes ends the input, because no answer is longer.
    """

    def __init__(self, longest: int = 4096) -> None:
        self._rest = b""
        self._ended = False
        self._longest = longest

    async def line(self) -> str | None:
        """The next line; None if the input has ended, or was closed from the start."""
        if sys.stdin is None:
            return None
        while b"\n" not in self._rest and not self._ended:
            await _readable(sys.stdin.fileno())
            got = os.read(sys.stdin.fileno(), 4096)
            self._ended = not got or len(self._rest) > self._longest
            self._rest += got
        if not self._rest:
            return None
        line, _, self._rest = self._rest.partition(b"\n")
        return line.decode(errors="replace").strip()

    async def ask(self, question: str, *, fresh: bool = False) -> str | None:
        """Ask on standard error, because standard output is for results; return the next line.

        Args:
            fresh: Discard earlier typing, because it answers another question.
        """
        if fresh and sys.stdin is not None and sys.stdin.isatty():
            termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)
        print(question, end=" ", file=sys.stderr, flush=True)
        line = await self.line()
        if line is None:
            print(file=sys.stderr)
        return line


async def input_ended() -> None:
    """Wait until the input ends, and discard it."""
    lines = InputLines()
    while await lines.line() is not None:
        pass


async def _readable(fd: int) -> None:
    loop = asyncio.get_running_loop()
    ready = asyncio.Event()
    try:
        loop.add_reader(fd, ready.set)
    except (OSError, ValueError):
        # A plain file can always be read.
        return
    try:
        await ready.wait()
    finally:
        loop.remove_reader(fd)
