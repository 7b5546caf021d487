"""The receiving side of the Rosmaster firmware: an interrupt and one buffer, byte for byte.

An incomplete frame waits for its end without a timeout, and takes it from the next frame. A new
frame overwrites one that still waits for the task, and both are lost.
"""

from __future__ import annotations

SIZE = 20


class OneBuffer:
    """The buffer.

    Attributes:
        waits: A frame is complete, and the task has not taken it yet.
    """

    def __init__(self) -> None:
        self.waits = False
        self._bytes = bytearray(SIZE)
        self._state = 0
        self._index = 0
        self._length = 0

    def clear(self) -> None:
        """Return to the state after a reset."""
        self.waits = False
        self._state = self._index = self._length = 0

    def receive(self, byte: int) -> None:
        """Take one byte."""
        if self._state == 0:
            if byte == 0xFF:
                self._bytes[0] = byte
                self._state = 1
        elif self._state == 1:
            if byte == 0xFC:
                self._bytes[1] = byte
                self._state = 2
            else:
                self._bytes[0] = self._state = 0
        elif self._state == 2:
            # Also while a frame waits: its length is this one from now on.
            self._length = (byte + 2) & 0xFF
            if self._length >= SIZE:
                self._state = self._length = self._bytes[0] = self._bytes[1] = 0
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
        """Take the waiting frame: its function and 16 bytes from its payload on, or None.

        Behind a payload that is too short lie zeros, or what a frame left that was written over.
        Without a length there is nothing to sum, and the byte before the buffer is the checksum:
        here it is 0, and what the buffer holds is executed.
        """
        if not self.waits:
            return None
        length = self._length
        valid = sum(self._bytes[2 : max(2, length - 1)]) & 0xFF == self._bytes[length - 1] * (
            length > 0
        )
        found = (self._bytes[3], bytes(self._bytes[4:])) if valid else None
        # A frame that is still arriving is truncated: its next byte ends it.
        self._bytes[:length] = bytes(length)
        self._length = 0
        self.waits = False
        return found
