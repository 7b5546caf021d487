"""A terminal that hands over each key at once, and is put back as it was on every way out."""

from __future__ import annotations

import asyncio
import os
import termios
from collections.abc import Callable
from typing import Any, Self

from yahboomd.cli.screens.keyboard import KeyParser

# Indices into what termios.tcgetattr returns.
_IFLAG, _LFLAG, _CC = 0, 3, 6

ESCAPE_S = 0.05
"""After an escape byte with nothing behind it for so long it was the key of that name."""

READ_BYTES = 1024


class Keys:
    """Keys from a terminal, on the running loop. A context manager.

    Ctrl-C stays a signal. What would suspend the process, kill it or hold its output back becomes a
    key (Ctrl-Z, Ctrl-Backslash, Ctrl-S): else it could stop no robot.

    Args:
        fd: The terminal.
        handler: Called on the loop with each key.
        hung_up: Called when the terminal is gone.
    """

    def __init__(
        self, fd: int, handler: Callable[[str], None], hung_up: Callable[[], None]
    ) -> None:
        self._fd = fd
        self._handler = handler
        self._hung_up = hung_up
        self._parser = KeyParser()
        self._before: list[Any] = []
        self._loop = asyncio.get_running_loop()
        self._flush: asyncio.TimerHandle | None = None

    def __enter__(self) -> Self:
        self._before = termios.tcgetattr(self._fd)
        attributes = termios.tcgetattr(self._fd)
        attributes[_IFLAG] &= ~termios.IXON
        attributes[_LFLAG] &= ~(termios.ICANON | termios.ECHO | termios.IEXTEN)
        attributes[_CC][termios.VMIN] = 1
        attributes[_CC][termios.VTIME] = 0
        attributes[_CC][termios.VSUSP] = attributes[_CC][termios.VQUIT] = b"\0"
        # What was typed before anybody looked was meant for somebody else.
        termios.tcsetattr(self._fd, termios.TCSAFLUSH, attributes)
        self._loop.add_reader(self._fd, self._read)
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.remove_reader(self._fd)
        if self._flush is not None:
            self._flush.cancel()
        try:
            termios.tcsetattr(self._fd, termios.TCSAFLUSH, self._before)
        except termios.error:
            # The terminal is gone: there is nothing left to put back.
            return

    def _read(self) -> None:
        try:
            data = os.read(self._fd, READ_BYTES)
        except OSError:
            data = b""
        if not data:
            self._loop.remove_reader(self._fd)
            self._hung_up()
            return
        if self._flush is not None:
            self._flush.cancel()
            self._flush = None
        self._hand_over(self._parser.feed(data))
        if self._parser.pending:
            self._flush = self._loop.call_later(
                ESCAPE_S, lambda: self._hand_over(self._parser.flush())
            )

    def _hand_over(self, keys: list[str]) -> None:
        for key in keys:
            self._handler(key)
