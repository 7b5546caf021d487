"""The receiving side of the Rosmaster firmware: an interrupt and one buffer, byte for byte.

A half frame waits for its end for ever, and takes it from the next frame. A frame that waits to be
looked at is written over by the one behind it.
"""

from __future__ import annotations

SIZE = 20


class OneBuffer:
    """The buffer.

    Attributes:
        waits: A frame was whole, and was not looked at yet.
    """

    def __init__(self) -> None:
        self.waits = False
        self._bytes = bytearray(SIZE)
        self._state = 0
        self._index = 0
        self._length = 0

    def clear(self) -> None:
        """Be as after a reset."""
        self.waits = False
        self._state = self._index = self._length = 0

    def receive(self, byte: int) -> None:
        """Take one byte."""
        if self._state == 0:
            if byte == 0xFF:
                self._bytes[0] = byte
                self._state = 1
        elif self._state == 1:
            self._state = 2 if byte == 0xFC else 0
            self._bytes[0] = 0xFF if byte == 0xFC else 0
            self._bytes[1] = byte
        elif self._state == 2:
            self._length = byte + 2
            if self._length >= SIZE:
                self._state = self._length = 0
                return
            self._bytes[2] = byte
            self._index, self._state = 3, 3
        else:
            self._bytes[self._index] = byte
            self._index += 1
            if self._index >= self._length:
                self._state = 0
                self.waits = True

    def take(self) -> tuple[int, bytes] | None:
        """Look: the function of the frame that waits and 16 bytes from its payload on, or None.

        Behind a payload that is too short lies what the buffer held before.
        """
        if not self.waits:
            return None
        self.waits = False
        length = self._length
        if length < 5 or sum(self._bytes[2 : length - 1]) & 0xFF != self._bytes[length - 1]:
            return None
        return self._bytes[3], bytes(self._bytes[4:])
