"""Questions to the person beside the robot; the robot's loop runs on while they are answered."""

from __future__ import annotations

import asyncio
import math
import os
import sys
from collections.abc import Callable

from yahboomd.errors import Refused


class Answers:
    """Lines of standard input. Questions go to standard error: standard output is the result."""

    def __init__(self) -> None:
        self._rest = b""
        self._ended = False

    async def line(self, question: str) -> str:
        """Ask, and wait for a line.

        Raises:
            Refused: The input ended.
        """
        print(question, end=" ", file=sys.stderr, flush=True)
        while b"\n" not in self._rest and not self._ended:
            await _readable(sys.stdin.fileno())
            got = os.read(sys.stdin.fileno(), 4096)
            self._ended = not got
            self._rest += got
        if not self._rest:
            print(file=sys.stderr)
            raise Refused(
                "The input ended before every question was answered: nothing was written."
            )
        line, _, self._rest = self._rest.partition(b"\n")
        return line.decode(errors="replace").strip()

    async def number(
        self,
        question: str,
        *,
        good: Callable[[float], bool],
        wrong: str,
        blank: float | None = None,
    ) -> float | None:
        """Ask until a number comes that is ``good``.

        Args:
            question: With the unit.
            good: Which numbers are possible.
            wrong: What to say of others.
            blank: The meaning of an empty line; None: it is returned as None.
        """
        while True:
            text = (await self.line(question)).replace(",", ".")
            if not text:
                return blank
            try:
                value = float(text)
            except ValueError:
                value = math.nan
            if math.isfinite(value) and good(value):
                return value
            print(wrong, file=sys.stderr)


async def _readable(fd: int) -> None:
    loop = asyncio.get_running_loop()
    ready = asyncio.Event()
    try:
        loop.add_reader(fd, ready.set)
    except (OSError, ValueError):
        # A plain file, which can always be read.
        return
    try:
        await ready.wait()
    finally:
        loop.remove_reader(fd)
