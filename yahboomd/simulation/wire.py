"""One direction of a serial line: bytes leave one after another, each taking ten bit times."""

from __future__ import annotations

from collections import deque

BITS_PER_BYTE = 10
"""8N1: a start bit, eight data bits, a stop bit."""


def transfer_ns(size: int, baud: int) -> int:
    """The time that ``size`` bytes take: 86.8 us each at 115200 baud."""
    return size * BITS_PER_BYTE * 1_000_000_000 // baud


class Wire:
    """Bytes on their way, on given time.

    Attributes:
        idle_ns: The arrival of the last byte sent so far.
    """

    def __init__(self, baud: int) -> None:
        self._baud = baud
        # Runs of bytes without a gap: the start of the first byte, the bytes, the number taken.
        self._runs: deque[tuple[int, bytes, int]] = deque()
        self.idle_ns = 0

    @property
    def empty(self) -> bool:
        """Whether nothing is on its way."""
        return not self._runs

    @property
    def first_ns(self) -> int:
        """The arrival of the next byte; only while not :attr:`empty`."""
        start_ns, _, taken = self._runs[0]
        return start_ns + transfer_ns(taken + 1, self._baud)

    def send(self, data: bytes, now_ns: int) -> None:
        """Put bytes on the line, behind those that are on it already."""
        if not data:
            return
        start_ns = max(now_ns, self.idle_ns)
        self._runs.append((start_ns, data, 0))
        self.idle_ns = start_ns + transfer_ns(len(data), self._baud)

    def take(self, now_ns: int) -> bytes:
        """The bytes that have arrived by ``now_ns`` and were not taken before."""
        taken = bytearray()
        while self._runs:
            start_ns, data, offset = self._runs[0]
            end = self._arrived(start_ns, now_ns, len(data))
            if end <= offset:
                break
            taken += data[offset:end]
            if end == len(data):
                self._runs.popleft()
            else:
                self._runs[0] = (start_ns, data, end)
                break
        return bytes(taken)

    def take_each(self, now_ns: int) -> list[tuple[int, int]]:
        """The same, as (byte, moment of its arrival)."""
        arrivals: list[tuple[int, int]] = []
        while self._runs:
            start_ns, data, offset = self._runs[0]
            end = self._arrived(start_ns, now_ns, len(data))
            if end <= offset:
                break
            arrivals += [
                (data[i], start_ns + transfer_ns(i + 1, self._baud)) for i in range(offset, end)
            ]
            if end == len(data):
                self._runs.popleft()
            else:
                self._runs[0] = (start_ns, data, end)
                break
        return arrivals

    def cut(self, now_ns: int) -> None:
        """Stop the sender: bytes that have not arrived by now never will."""
        kept: deque[tuple[int, bytes, int]] = deque()
        for start_ns, data, taken in self._runs:
            arrived = self._arrived(start_ns, now_ns, len(data))
            if arrived > taken:
                kept.append((start_ns, data[:arrived], taken))
        self._runs = kept
        self.idle_ns = min(self.idle_ns, now_ns)

    def clear(self) -> None:
        """Lose everything that is on its way."""
        self._runs.clear()
        self.idle_ns = 0

    def _arrived(self, start_ns: int, now_ns: int, size: int) -> int:
        """Count the bytes of a run that have arrived: the most n with n byte times elapsed."""
        elapsed_ns = now_ns - start_ns
        if elapsed_ns <= 0:
            return 0
        count = elapsed_ns * self._baud // (BITS_PER_BYTE * 1_000_000_000)
        # Transfer times are rounded down: the next byte may be there already.
        if transfer_ns(count + 1, self._baud) <= elapsed_ns:
            count += 1
        return min(size, count)
