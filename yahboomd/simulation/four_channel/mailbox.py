"""The input of the streamed firmware: a collector, and a mailbox for one command.

- ``$`` opens a frame, ``#`` closes it; between them everything is data, ``$`` and newlines too.
- Outside a frame everything is ignored.
- A frame of more than 51 characters is discarded at its 52nd.
- Of a finished frame and a too long one the main loop sees only the later.
- A finished frame overwrites the mailbox, and the main loop wipes the mailbox after each command: a
  frame that arrived meanwhile is empty when the loop takes it.
"""

from __future__ import annotations

LONGEST_FRAME = 51
"""Characters between ``$`` and ``#``."""

_OPEN = ord("$")
_CLOSE = ord("#")


class Mailbox:
    """The receiving end of the firmware."""

    def __init__(self) -> None:
        self.ready = False
        self.too_long = False
        self._content = b""
        self._collected: bytearray | None = None

    def put(self, byte: int) -> bool:
        """Take one byte; return whether the main loop now has something to do."""
        if self._collected is None:
            if byte == _OPEN:
                self._collected = bytearray()
            return False
        if byte == _CLOSE:
            self._content = bytes(self._collected)
            self._collected = None
            self.ready, self.too_long = True, False
            return True
        self._collected.append(byte)
        if len(self._collected) > LONGEST_FRAME:
            self._collected = None
            self.ready, self.too_long = False, True
            return True
        return False

    def spoil(self) -> None:
        """Damage the finished frame beyond recognition."""
        self._content = b"\x00" + self._content[1:]

    def take(self) -> bytes:
        """Return the newest finished frame to the main loop; empty if it was wiped."""
        self.ready = False
        return self._content

    def wipe(self) -> None:
        """Clear the content, even if it belongs to a newer frame by now."""
        self._content = b""

    def reset(self) -> None:
        """Discard everything, incomplete frames too."""
        self.ready = self.too_long = False
        self._content = b""
        self._collected = None
