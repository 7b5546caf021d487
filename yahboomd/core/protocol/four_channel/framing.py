"""Cuts bytes into frames and text lines.

The law: the items depend on the bytes, not on how they were cut into chunks. No input raises, and
the buffer is bounded.

The board sends two kinds of things on one wire: frames, ``$name:args#``, and bare text lines such
as ``Set mtype:OK!``, ended by CR LF. Three bytes steer the framer, wherever they come:

- ``$`` starts a frame. Held bytes before it, half a frame or half a line, are discarded: a new
  start is the surest sign that the old one lost its end, and the new frame is worth more.
- ``#`` ends a frame at once, without waiting for a line end (one dialect promises none).
  Without a ``$`` before it, it ends the tail of a frame whose head was lost; both are discarded.
- LF ends everything. Held text becomes a line. Half a frame becomes a line as well, ``$``
  included: a board that resets while it sends appends its start-up banner to the half frame, and
  that notice must not be lost. It cannot be mistaken for an answer: none starts with ``$``.

Here bytes become text that people read on terminals and in logs: control characters, with which
a board could command a terminal, are replaced like bytes that are not ASCII.
"""

from __future__ import annotations

import re
from typing import Final, TypeAlias

import msgspec

from yahboomd.core.protocol.dialect import FramerCounters

RESYNC: Final = b"\n" * 64
"""Brings the *board's* parser back to the start of a frame from any state.

Firmware 1.7.3 takes ``$`` inside a frame as data and collects up to 51 bytes; 52 newlines are the
least that overflow it (observed under emulation). The next command may follow at once.
"""

MAX_HELD_BYTES: Final = 160
"""The most bytes that an unfinished frame or line may have.

The longest true one has three gains that the flash has lost (144 bytes).
"""

_STEERING = re.compile(rb"[$#\n]")
_WHOLE = re.compile(rb"\$([^$#\n]*)#(\r\n)?")
_DOLLAR: Final = ord("$")
_HASH: Final = ord("#")
_PLAIN: Final = bytes(range(0x20, 0x7F)) + b"\t\r\n"
# Map control bytes to 0xFF, which decoding replaces.
_READABLE: Final = bytes(
    byte if byte in _PLAIN and byte not in b"\r\n" else 0xFF for byte in range(256)
)


class Frame(msgspec.Struct, frozen=True, kw_only=True):
    """A whole frame, ``$name:args#``.

    Attributes:
        name: The text before the first colon, or all of it if there is none.
        args: The text behind the first colon. Bytes that are neither printable ASCII nor tab
            appear as U+FFFD.
        size: Bytes on the wire from ``$`` to ``#``, both included.
        trailing: Bytes of the same chunk behind the ``#``: they arrived later.
    """

    name: str
    args: str
    size: int
    trailing: int


class TextLine(msgspec.Struct, frozen=True, kw_only=True):
    """A line that is no frame, without its line end; never empty.

    Attributes:
        text: The line. Bytes that are neither printable ASCII nor tab appear as U+FFFD.
        size: Bytes on the wire, the line end included.
        trailing: Bytes of the same chunk behind the line end: they arrived later.
    """

    text: str
    size: int
    trailing: int


Item: TypeAlias = Frame | TextLine
"""The items that a framer finds."""


class LineFramer:
    """Cuts received bytes into frames and text lines.

    It holds at most :data:`MAX_HELD_BYTES` bytes, and never raises.
    """

    def __init__(self) -> None:
        self.counters = FramerCounters()
        # Starts with "$" inside a frame and nowhere else: the bytes held are the whole state.
        self._held = bytearray()
        # Behind an overlong frame or line, until the next steering byte.
        self._skipping = False

    @property
    def held_bytes(self) -> int:
        return len(self._held)

    def feed(self, data: bytes) -> list[Frame | TextLine]:
        """Take a chunk as received; return the items that it completes, in order."""
        counters = self.counters
        counters.bytes += len(data)
        counters.bad_bytes += len(data.translate(None, _PLAIN))
        items: list[Frame | TextLine] = []
        if _STEERING.search(data) is None:
            self._hold(data)
            return items
        if self._held:
            # A chunk may end anywhere.
            data = bytes(self._held) + data
            self._held.clear()
        start = 0
        if not self._skipping:
            start = self._whole_frames(data, items)
        for match in _STEERING.finditer(data, start):
            at = match.start()
            self._hold(data[start:at])
            start = at + 1
            item = self._steer(data[at], trailing=len(data) - start)
            if item is not None:
                items.append(item)
        self._hold(data[start:])
        return items

    def _whole_frames(self, data: bytes, items: list[Frame | TextLine]) -> int:
        """Take the whole frames at the beginning, with their line ends; return where they end.

        The result is the same as from steering byte to steering byte, at a third of the cost, for
        nearly all that a board sends.
        """
        start = 0
        while (match := _WHOLE.match(data, start)) is not None:
            held = match[1]
            if len(held) >= MAX_HELD_BYTES:
                break
            end = start + len(held) + 2
            items.append(self._frame(held, len(data) - end))
            start = match.end()
            self.counters.blank_bytes += start - end
        return start

    def _hold(self, part: bytes) -> None:
        held = self._held
        if not self._skipping:
            if len(held) + len(part) <= MAX_HELD_BYTES:
                held += part
                return
            self.counters.overlong += 1
            self.counters.discarded_bytes += len(held)
            held.clear()
            self._skipping = True
        self.counters.discarded_bytes += len(part)

    def _steer(self, byte: int, *, trailing: int) -> Frame | TextLine | None:
        held = bytes(self._held)
        skipping, self._skipping = self._skipping, False
        self._held.clear()
        in_frame = held.startswith(b"$")
        if byte == _DOLLAR:
            self._held.append(byte)
            self._drop(held, broken=in_frame)
            return None
        if byte == _HASH:
            if in_frame:
                return self._frame(held[1:], trailing)
            self._drop(held + b"#")
            return None
        if skipping:
            self._drop(b"\n")
            return None
        return self._line(held, trailing, broken=in_frame)

    def _frame(self, inside: bytes, trailing: int) -> Frame:
        self.counters.frames += 1
        name, _, args = _text(inside).partition(":")
        return Frame(name=name, args=args, size=len(inside) + 2, trailing=trailing)

    def _line(self, held: bytes, trailing: int, *, broken: bool) -> TextLine | None:
        text = held.rstrip(b"\r")
        size = len(held) + 1
        if not text:
            self.counters.blank_bytes += size
            return None
        self.counters.broken_frames += broken
        self.counters.lines += 1
        return TextLine(text=_text(text), size=size, trailing=trailing)

    def _drop(self, held: bytes, *, broken: bool = False) -> None:
        self.counters.broken_frames += broken
        if held.strip(b"\r"):
            self.counters.discarded_bytes += len(held)
        else:
            self.counters.blank_bytes += len(held)


def _text(data: bytes) -> str:
    return data.translate(_READABLE).decode("ascii", "replace")
