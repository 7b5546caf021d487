"""Runs `yahboomd` commands in processes of their own, which never outlive the server.

A child leads its own process group. Only the server holds the pipe to its standard input: the child
ends when that is closed, also if the server is killed.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import sys
from collections import deque
from collections.abc import AsyncIterator, Sequence
from typing import Any

END_S = 8.0
"""The time for a child to stop its robot, or to finish its files, before it is killed."""

LINE_BYTES = 1 << 20

LAST_WORDS = 20
"""The number of lines of its standard error that are kept."""


class Child:
    """One running command; made by :meth:`start`."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process
        self._errors = deque[str](maxlen=LAST_WORDS)
        self._reading = asyncio.create_task(self._read_errors(), name="web-child-errors")

    @classmethod
    async def start(cls, arguments: Sequence[str]) -> Child:
        """Start ``yahboomd`` with a list of arguments, which no shell reads, in our environment."""
        return cls(
            await asyncio.create_subprocess_exec(
                *(sys.executable, "-m", "yahboomd", *arguments),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.PIPE,
                limit=LINE_BYTES,
                start_new_session=True,
            )
        )

    async def _read_errors(self) -> None:
        assert self._process.stderr is not None
        with contextlib.suppress(ValueError):
            async for line in self._process.stderr:
                self._errors.append(line.decode(errors="replace").rstrip())

    @property
    def last_words(self) -> str:
        """The end of what it wrote to standard error, without the program's name."""
        return "\n".join(self._errors).removeprefix("yahboomd: ")

    async def lines(self) -> AsyncIterator[dict[str, Any]]:
        """The JSON objects that it writes, one a line; other lines are ignored."""
        assert self._process.stdout is not None
        with contextlib.suppress(ValueError):
            async for line in self._process.stdout:
                with contextlib.suppress(ValueError):
                    found = json.loads(line)
                    if isinstance(found, dict):
                        yield found

    def close_input(self) -> None:
        """Ask it to end."""
        assert self._process.stdin is not None
        self._process.stdin.close()

    async def end(self) -> int:
        """End it, by force if necessary; returns its exit status."""
        self.close_input()
        try:
            async with asyncio.timeout(END_S):
                status = await self._process.wait()
                # Nothing of its process group holds its output open.
                await self._reading
        except TimeoutError:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            status = await self._process.wait()
        finally:
            self._reading.cancel()
        return status


async def output_of(arguments: Sequence[str], within_s: float = 30.0) -> tuple[int, str, str]:
    """Run a command to its end; returns its exit status, its output, and its last words.

    One that takes too long is ended, and its last words report that.
    """
    child = await Child.start(arguments)
    stdout = child._process.stdout  # noqa: SLF001
    assert stdout is not None
    try:
        async with asyncio.timeout(within_s):
            printed = await stdout.read()
    except TimeoutError:
        return os.EX_TEMPFAIL, "", f"It took longer than {within_s:g} s, and was ended."
    finally:
        status = await child.end()
    return status, printed.decode(errors="replace"), child.last_words
