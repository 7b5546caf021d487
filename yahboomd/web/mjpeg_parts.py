"""Cuts a stream of MJPEG (``multipart/x-mixed-replace``) into pictures; needs no connection.

A camera's server is not trusted: the buffer is bounded, and every picture is checked to be a JPEG
that a browser can show.
"""

from __future__ import annotations

import re

MAX_PICTURE_BYTES = 1 << 20

MAX_PIXELS = 3840 * 2160
"""A picture of 4K; a browser needs four bytes for each pixel."""

MAX_HEAD_BYTES = 4096
"""The most bytes of a part's header, and between two parts."""

_LENGTH = re.compile(rb"^content-length:[ \t]*(\d{1,9})[ \t]*\r?$", re.IGNORECASE | re.MULTILINE)
_END_OF_HEAD = re.compile(rb"\r?\n\r?\n")
_FRAME_HEADERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
MAX_SEGMENTS = 64


class CameraRefusal(Exception):
    """The camera's server sent something that is not passed on.

    Attributes:
        cause: A word, under which it is counted.
        words: For people, as the end of a sentence that begins with the camera.
    """

    def __init__(self, cause: str, words: str) -> None:
        super().__init__(words)
        self.cause = cause
        self.words = words


class MjpegParts:
    """Cuts one connection's stream.

    Args:
        boundary: As the Content-Type has it.

    Attributes:
        unusable: The number of parts that were no JPEG, or one too large to show.
    """

    def __init__(self, boundary: str) -> None:
        # Some servers write the two dashes into the Content-Type too.
        self._mark = b"--" + boundary.encode("ascii", "replace").removeprefix(b"--")
        self._buffer = bytearray()
        self._searched = 0
        self._in_body = False
        self._length: int | None = None
        self.unusable = 0

    def feed(self, data: bytes | bytearray) -> list[bytes]:
        """Take in bytes; return the pictures that are complete.

        Raises:
            CameraRefusal: A header or a picture is too large, or there is no boundary.
        """
        self._buffer += data
        found: list[bytes] = []
        while True:
            if not self._in_body:
                if not self._begin():
                    return found
            elif (part := self._part()) is None:
                return found
            elif is_shown(part):
                found.append(part)
            else:
                self.unusable += 1

    def _begin(self) -> bool:
        """Find the next boundary and read the header after it; whether both are complete."""
        at = self._buffer.find(self._mark)
        if at < 0:
            if len(self._buffer) > MAX_HEAD_BYTES:
                raise CameraRefusal("no_boundary", "sends data without the boundary that it named")
            return False
        head = _END_OF_HEAD.search(self._buffer, at)
        if head is None:
            if len(self._buffer) - at > MAX_HEAD_BYTES:
                raise CameraRefusal("endless_header", "sends a header that does not end")
            return False
        length = _LENGTH.search(self._buffer, at, head.end())
        self._length = None if length is None else int(length[1])
        if (self._length or 0) > MAX_PICTURE_BYTES:
            raise _too_large()
        del self._buffer[: head.end()]
        self._in_body = True
        self._searched = 0
        return True

    def _part(self) -> bytes | None:
        """The part's bytes, once they are complete."""
        end = len(self._buffer) if self._length is None else self._length
        if self._length is None:
            end = self._buffer.find(self._mark, self._searched)
            # The boundary may have arrived in part.
            self._searched = max(0, len(self._buffer) - len(self._mark))
        if not 0 <= end <= len(self._buffer):
            if len(self._buffer) > MAX_PICTURE_BYTES + MAX_HEAD_BYTES:
                raise _too_large()
            return None
        part = bytes(self._buffer[:end])
        del self._buffer[:end]
        self._in_body = False
        return part


def _too_large() -> CameraRefusal:
    return CameraRefusal(
        "large", f"sends pictures of more than {MAX_PICTURE_BYTES >> 10} kB: make them smaller"
    )


def is_shown(part: bytes) -> bool:
    """Whether this is a JPEG, of no more than :data:`MAX_PIXELS`, by its first header."""
    if part[:2] != b"\xff\xd8":
        return False
    at = 2
    for _ in range(MAX_SEGMENTS):
        if part[at : at + 1] != b"\xff":
            return False
        kind, size = part[at + 1 : at + 2], int.from_bytes(part[at + 2 : at + 4], "big")
        if not kind or size < 2:
            return False
        if kind[0] in _FRAME_HEADERS:
            height = int.from_bytes(part[at + 5 : at + 7], "big")
            width = int.from_bytes(part[at + 7 : at + 9], "big")
            return 0 < width * height <= MAX_PIXELS
        at += 2 + size
    return False
