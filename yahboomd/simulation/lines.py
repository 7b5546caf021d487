"""Files of JSON lines, written while the simulation runs and read by other programs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TypeVar

import msgspec

Line = TypeVar("Line", bound=msgspec.Struct)


class LinesWriter:
    """Appends one JSON object a line.

    Args:
        path: The file, replaced at :meth:`open`.
        flush_every: Lines between two flushes: a killed simulator loses at most these, and a
            reader waits for them.
    """

    def __init__(self, path: Path, *, flush_every: int = 1) -> None:
        self._path = path
        self._flush_every = flush_every
        self._encoder = msgspec.json.Encoder()
        self._file: IO[bytes] | None = None
        self._unflushed = 0

    def open(self) -> None:
        """Start an empty file."""
        self._file = self._path.open("wb")

    def write(self, line: msgspec.Struct) -> None:
        """Append one object; nothing after :meth:`close`."""
        if self._file is None:
            return
        with self._named():
            self._file.write(self._encoder.encode(line) + b"\n")
            self._unflushed += 1
            if self._unflushed >= self._flush_every:
                self._file.flush()
                self._unflushed = 0

    def close(self) -> None:
        """Flush and close; safe to call twice."""
        file, self._file = self._file, None
        if file is not None:
            with self._named():
                file.close()

    @contextmanager
    def _named(self) -> Iterator[None]:
        """Raise an error of the disk with the file's name."""
        try:
            yield
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self._path)) from error


def read_lines(path: Path, line: type[Line]) -> list[Line]:
    """All complete lines of a file, oldest first; a half line at its end is left out.

    Raises:
        OSError: The file cannot be read.
        msgspec.MsgspecError: A complete line is no such object.
    """
    decoder = msgspec.json.Decoder(line)
    return [decoder.decode(each) for each in path.read_bytes().split(b"\n")[:-1]]
