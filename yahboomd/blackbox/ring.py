"""Writes records into a fixed ring of segments, over the oldest ones.

Law: after a kill at any moment, the ring is readable and holds every record that was written:
each is a write of its own. A write within a page of memory is done whole or not at all. A record on
two pages gets its kind, its first byte, last; and the place behind the latest record is zero.
"""

from __future__ import annotations

from collections.abc import Callable

from yahboomd.blackbox.box_file import SEGMENT
from yahboomd.blackbox.records import BASE, HEAD, MOMENT, RECEIVED, REPEATED

_HEAD_BYTES = HEAD.size
_pack = HEAD.pack
_PAGE_BITS = 12
SPAN_NS = 1 << 32
"""Moments are written in 32 bits: after 4.3 s they are counted from a new base."""

EARLIER_NS = 1_000_000_000
"""Records come in order, but a moment may be a little before that of the last record."""

Store = Callable[[bytes, int], object]
"""Writes bytes to a place in the box."""


class Ring:
    """The segments of a box.

    Args:
        store: Writes to the box, which holds zeros.
        begin: The start of the first one; a multiple of 4096, like their size.
        segment_bytes: The size of each.
        count: Their number.

    Attributes:
        turned: A segment was begun, and its first records are not written yet.
        on_turned: Called when that becomes so.
        left_out: Records that were dropped because they were too large.
    """

    def __init__(self, store: Store, begin: int, segment_bytes: int, count: int) -> None:
        self._store = store
        self._begin = begin
        self._segment_bytes = segment_bytes
        self._count = count
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
            at_ns: When it was made; monotonic nanoseconds.

        Raises:
            OSError: There is no room for it any more.
        """
        end = self._at + _HEAD_BYTES + len(payload)
        since_ns = at_ns - self._base_ns
        if end > self._end or not 0 <= since_ns < SPAN_NS:
            if not self._make_room(len(payload), at_ns):
                self.left_out += 1
                return
            since_ns = at_ns - self._base_ns
        self._put(_pack(kind, len(payload), since_ns) + payload)

    def write_read(self, data: bytes, at_ns: int) -> None:
        """Write a read of the port; one with the same bytes as the last takes only a head."""
        since_ns = at_ns - self._base_ns
        if data == self._read and self._at + _HEAD_BYTES <= self._end and 0 <= since_ns < SPAN_NS:
            self._put(_pack(REPEATED, 0, since_ns))
            return
        self.write(RECEIVED, data, at_ns)
        self._read = data

    def _put(self, record: bytes) -> None:
        at = self._at
        end = at + len(record)
        if at >> _PAGE_BITS == (end - 1) >> _PAGE_BITS:
            self._store(record, at)
        else:
            self._store(record[1:], at + 1)
            self._store(record[:1], at)
        self._at = end

    def _make_room(self, size: int, at_ns: int) -> bool:
        """Begin a segment or set a base; return whether a payload of this size fits then."""
        needed = 2 * HEAD.size + MOMENT.size + size
        if needed + SEGMENT.size > self._segment_bytes:
            return False
        if self._at + needed > self._end:
            self._turn()
        self._base_ns = max(0, at_ns - EARLIER_NS)
        self._put(_pack(BASE, MOMENT.size, 0) + MOMENT.pack(self._base_ns))
        return True

    def _turn(self) -> None:
        start = self._begin + self._number % self._count * self._segment_bytes
        self._store(b"\0", start)
        self._store(self._zeros, start)
        self._number += 1
        # A segment must be readable without the one before it.
        self._read = None
        self._store(SEGMENT.pack(1, self._number), start)
        self._at, self._end = start + SEGMENT.size, start + self._segment_bytes
        self.turned = True
        self.on_turned()
