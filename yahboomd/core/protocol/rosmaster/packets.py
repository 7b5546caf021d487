"""Bytes in, packets and text lines out, and the frames to the board.

The law: the items depend on the bytes, not on how they were cut into chunks. No input raises, and
the buffer is bounded.

A frame is ``FF id LEN FUNCTION payload CHK`` with id FC to the board and FB from it. LEN counts
itself, FUNCTION, payload and CHK; CHK is the sum of LEN, FUNCTION and payload, modulo 256. Lines of
text share the wire: they announce a start, and work on the flash.
"""

from __future__ import annotations

import re
from typing import Final, TypeAlias

import msgspec

from yahboomd.core.protocol.dialect import FramerCounters

START: Final = 0xFF
TO_BOARD: Final = 0xFC
FROM_BOARD: Final = 0xFB

LEN_LEAST: Final = 3
LEN_MOST: Final = 40
"""The longest true frame has 21; some builds lengthen them. A larger one is a garbled byte."""

LINE_MOST: Final = 128
"""The most that is kept of a line: its end."""

RESYNC: Final = bytes(20)
"""As many bytes as the board's buffer holds: they end half a frame, which is then invalid."""

_TEXT = re.compile(rb"[\t\r\x20-\x7e]*")


def frame(function: int, *payload: int) -> bytes:
    """A frame to the board.

    Args:
        payload: The bytes, each 0 to 255.
    """
    inside = bytes((len(payload) + 3, function, *payload))
    return bytes((START, TO_BOARD)) + inside + bytes((sum(inside) & 0xFF,))


class Packet(msgspec.Struct, frozen=True, kw_only=True):
    """A frame from the board whose checksum is right.

    Attributes:
        payload: The bytes between function and checksum.
        size: Bytes on the wire.
        trailing: Bytes of the same chunk behind it: they arrived later.
    """

    function: int
    payload: bytes
    size: int
    trailing: int


class Words(msgspec.Struct, frozen=True, kw_only=True):
    """A line of text between frames; never empty.

    Attributes:
        text: Printable ASCII and tabs, without the line end.
        size: Bytes on the wire, the line end included.
        trailing: Bytes of the same chunk behind it: they arrived later.
    """

    text: str
    size: int
    trailing: int


Item: TypeAlias = Packet | Words


class PacketFramer:
    """Finds frames by their first bytes, length and checksum, and lines of text between them."""

    def __init__(self) -> None:
        self.counters = FramerCounters()
        self._held = bytearray()

    @property
    def held_bytes(self) -> int:
        return len(self._held)

    def feed(self, data: bytes) -> list[Item]:
        """Take a chunk as received; return the items that it completes, in order."""
        self.counters.bytes += len(data)
        held = self._held
        held += data
        items: list[Item] = []
        while held:
            before = len(held)
            item = self._packet() if held[0] == START else self._words()
            if item is not None:
                items.append(item)
            elif len(held) == before:
                break
        return items

    def _packet(self) -> Packet | None:
        """The frame at the beginning; None if more bytes are needed, or one was dropped."""
        held, counters = self._held, self.counters
        if len(held) > 1 and held[1] != FROM_BOARD:
            self._drop(1)
            return None
        if len(held) < 3:
            return None
        if not LEN_LEAST <= held[2] <= LEN_MOST:
            counters.overlong += held[2] > LEN_MOST
            self._drop(1)
            return None
        size = held[2] + 2
        if len(held) < size:
            return None
        inside, check = bytes(held[2 : size - 1]), held[size - 1]
        if sum(inside) & 0xFF != check:
            # This may be no start, and the next one may be inside.
            counters.broken_frames += 1
            self._drop(1)
            return None
        del held[:size]
        counters.frames += 1
        return Packet(function=inside[1], payload=inside[2:], size=size, trailing=len(held))

    def _words(self) -> Words | None:
        """The line at the beginning; None if more bytes are needed, or some were dropped."""
        held, counters = self._held, self.counters
        match = _TEXT.match(held)
        assert match is not None, "it matches nothing, too"
        end = match.end()
        # Keep the end of an overlong line, even before its line end has come.
        if end > LINE_MOST:
            self._drop(end - LINE_MOST)
            return None
        if end == len(held):
            return None
        if held[end] != 0x0A:
            self._drop(end or 1)
            return None
        line = bytes(held[:end]).strip(b"\r")
        del held[: end + 1]
        if not line:
            counters.blank_bytes += end + 1
            return None
        counters.lines += 1
        text = line.replace(b"\r", b" ").decode("ascii")
        return Words(text=text, size=end + 1, trailing=len(held))

    def _drop(self, count: int) -> None:
        self.counters.discarded_bytes += count
        del self._held[:count]
