"""Writes records into a fixed ring of segments, over the oldest ones.

Law: whenever the process is killed, the ring is readable; at most the record that was being written
is missing. The last byte of a record that is written is its kind, and the place behind the latest
record is zero.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Callable

from yahboomd.blackbox.box_file import SEGMENT
from yahboomd.blackbox.records import BASE, HEAD, MOMENT, RECEIVED, REPEATED

_LENGTH_AND_TIME = struct.Struct("<HI")
_pack_into = _LENGTH_AND_TIME.pack_into
_HEAD_BYTES = HEAD.size
SPAN_NS = 1 << 32
"""Moments are written in 32 bits: after 4.3 s they are counted from another base."""

EARLIER_NS = 1_000_000_000
"""Records come in their order, but a moment may be a little before the one of the last record."""


class Ring:
    """The segments of a box.

    Args:
        buffer: Where they are; zeros.
        begin: Where the first one begins.
        segment_bytes: The size of each.

    Attributes:
        turned: A segment was begun, and what every segment should begin with is not written yet.
        on_turned: Called when that becomes so.
        left_out: Records that were too large.
    """

    def __init__(self, buffer: mmap.mmap | bytearray, begin: int, segment_bytes: int) -> None:
        self._buffer = memoryview(buffer)
        self._begin = begin
        self._segment_bytes = segment_bytes
        self._count = (len(buffer) - begin) // segment_bytes
        self._zeros = bytes(segment_bytes)
        self._number = 0
        self._at = self._end = 0
        self._base_ns = 0
        self._read: bytes | None = None
        self.turned = False
        self.on_turned: Callable[[], None] = lambda: None
        self.left_out = 0

    def write(self, kind: int, payload: bytes, at_ns: int) -> None:
        """Write a record.

        Args:
            kind: Its kind.
            payload: Its content.
            at_ns: When it was made; monotonic nanoseconds.
        """
        at = self._at
        begin = at + _HEAD_BYTES
        end = begin + len(payload)
        since_ns = at_ns - self._base_ns
        if end > self._end or not 0 <= since_ns < SPAN_NS:
            if not self._make_room(len(payload), at_ns):
                self.left_out += 1
                return
            at = self._at
            begin = at + _HEAD_BYTES
            end = begin + len(payload)
            since_ns = at_ns - self._base_ns
        buffer = self._buffer
        buffer[begin:end] = payload
        _LENGTH_AND_TIME.pack_into(buffer, at + 1, len(payload), since_ns)
        # A store of one byte: there, or not there.
        buffer[at] = kind
        self._at = end

    def write_read(self, data: bytes, at_ns: int) -> None:
        """Write a read of the port; where it brought the same bytes as the last one, in short."""
        at = self._at
        since_ns = at_ns - self._base_ns
        begin = at + _HEAD_BYTES
        # Several hundred times a second: as `write`, without another call.
        if 0 <= since_ns < SPAN_NS:
            buffer = self._buffer
            if data == self._read:
                if begin <= self._end:
                    _pack_into(buffer, at + 1, 0, since_ns)
                    buffer[at] = REPEATED
                    self._at = begin
                    return
            elif (end := begin + len(data)) <= self._end:
                buffer[begin:end] = data
                _pack_into(buffer, at + 1, end - begin, since_ns)
                buffer[at] = RECEIVED
                self._at = end
                self._read = data
                return
        self.write(RECEIVED, data, at_ns)
        self._read = data

    def _make_room(self, size: int, at_ns: int) -> bool:
        """Begin a segment or set a base; whether a payload of this size fits then."""
        needed = 2 * HEAD.size + MOMENT.size + size
        if needed + SEGMENT.size > self._segment_bytes:
            return False
        if self._at + needed > self._end:
            self._turn()
        self._base_ns = max(0, at_ns - EARLIER_NS)
        at = self._at
        MOMENT.pack_into(self._buffer, at + _HEAD_BYTES, self._base_ns)
        _LENGTH_AND_TIME.pack_into(self._buffer, at + 1, MOMENT.size, 0)
        self._buffer[at] = BASE
        self._at = at + _HEAD_BYTES + MOMENT.size
        return True

    def _turn(self) -> None:
        """Begin the next segment: the oldest one is lost."""
        buffer = self._buffer
        start = self._begin + self._number % self._count * self._segment_bytes
        buffer[start] = 0
        buffer[start : start + self._segment_bytes] = self._zeros
        self._number += 1
        # A segment has to be readable without the one before it.
        self._read = None
        SEGMENT.pack_into(buffer, start, 0, self._number)
        buffer[start] = 1
        self._at, self._end = start + SEGMENT.size, start + self._segment_bytes
        self.turned = True
        self.on_turned()
