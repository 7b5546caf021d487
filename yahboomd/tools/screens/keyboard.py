"""Reads a terminal's bytes as keys, each at once, and restores the terminal on every way out.

A library for whole screens could read the keys too, but splits a sequence that it does not know:
the ``d`` of ``ESC [ d`` would turn the robot. Here it is one unknown key, which stops the robot.
"""

from __future__ import annotations

import asyncio
import codecs
import os
import re
import termios
from collections.abc import Callable
from typing import Any, Self

ESCAPE = "escape"
UNKNOWN = "unknown"

ESCAPE_S = 0.05
"""An escape byte that nothing follows for this time was the Escape key."""

READ_BYTES = 1024

# Indices into what termios.tcgetattr returns.
_IFLAG, _LFLAG, _CC = 0, 3, 6

_ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left"}

# A sequence ends with a letter, before a character that cannot belong to it, or after more
# characters than any key has.
_KEY = re.compile(
    r"\x1b(?:O(?P<short>.)|\[[ -?]{0,29}(?:(?P<long>[@-~])|(?=[^ -~]))|\[[ -?]{30}|[^O\[\x1b])"
    r"|(?P<escape>\x1b(?=\x1b))|(?P<plain>[^\x1b])",
    re.DOTALL,
)


class KeyParser:
    """Cuts a terminal's bytes into keys, however reads split them.

    If a read ended inside an arrow's ``ESC [ A`` and the parts were taken for keys, the ``A`` would
    turn the robot.
    """

    def __init__(self) -> None:
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")
        self._text = ""

    @property
    def pending(self) -> bool:
        """Whether a key is incomplete. If nothing follows soon, it is the Escape key."""
        return bool(self._text or self._decoder.getstate()[0])

    def feed(self, data: bytes) -> list[str]:
        """The keys that these bytes complete, as characters or names."""
        self._text += self._decoder.decode(data)
        keys = list[str]()
        while (found := _KEY.match(self._text)) is not None:
            self._text = self._text[found.end() :]
            keys.append(_name(found))
        return keys

    def flush(self) -> list[str]:
        """End an incomplete key that nothing followed; returns it."""
        if not self.pending:
            return []
        key = ESCAPE if self._text == "\x1b" else UNKNOWN
        self._decoder.reset()
        self._text = ""
        return [key]


def _name(found: re.Match[str]) -> str:
    if found["escape"]:
        return ESCAPE
    if found["plain"]:
        return UNKNOWN if found["plain"] == "\N{REPLACEMENT CHARACTER}" else found["plain"]
    return _ARROWS.get(found["short"] or found["long"] or "", UNKNOWN)


class Keys:
    """Keys from a terminal, on the running loop. A context manager.

    Ctrl-C stays a signal. Ctrl-Z, Ctrl-Backslash and Ctrl-S become keys: otherwise they would
    suspend or kill the process or hold its output back, and it could stop no robot.

    Args:
        reads: Called before the keys of each read are handed over.
    """

    def __init__(
        self,
        fd: int,
        handler: Callable[[str], None],
        hung_up: Callable[[], None],
        *,
        reads: Callable[[], None] = lambda: None,
    ) -> None:
        self._fd = fd
        self._handler = handler
        self._hung_up = hung_up
        self._reads = reads
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
        # Discards earlier typing, which was meant for another program.
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
            # The terminal is gone, and its modes with it.
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
        self._reads()
        self._hand_over(self._parser.feed(data))
        if self._parser.pending:
            self._flush = self._loop.call_later(
                ESCAPE_S, lambda: self._hand_over(self._parser.flush())
            )

    def _hand_over(self, keys: list[str]) -> None:
        for key in keys:
            self._handler(key)
