"""What the host says and when: the stamps that stop latencies are measured with.

A file of JSON lines, one for each read of the port, flushed at once. Stamps are CLOCK_MONOTONIC at
the moment the bytes had left the host's write, before the simulated wire delays them.
"""

from __future__ import annotations

from pathlib import Path
from typing import IO

import msgspec


class Heard(msgspec.Struct, frozen=True, kw_only=True):
    """Bytes of the host.

    Attributes:
        t_ns: Monotonic nanoseconds.
        data: The bytes as Latin-1 text: each character is one byte.
    """

    t_ns: int
    data: str


class HeardWriter:
    """Writes what the host says to a file; :meth:`write` is what a port's ``on_heard`` takes.

    Args:
        path: The file, replaced at :meth:`open`.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._encoder = msgspec.json.Encoder()
        self._file: IO[bytes] | None = None

    def open(self) -> None:
        """Start an empty file.

        Raises:
            OSError: It cannot be written.
        """
        self._file = self._path.open("wb", buffering=0)

    def write(self, data: bytes, t_ns: int) -> None:
        """Append bytes; nothing after :meth:`close`."""
        if self._file is not None:
            heard = Heard(t_ns=t_ns, data=data.decode("latin-1"))
            self._file.write(self._encoder.encode(heard) + b"\n")

    def close(self) -> None:
        """Close; safe to call twice."""
        if self._file is not None:
            self._file.close()
            self._file = None


def read_heard(path: Path) -> list[Heard]:
    """All complete lines of a file, oldest first; a half line at its end is left out.

    Raises:
        OSError: The file cannot be read.
        msgspec.MsgspecError: A complete line is none of ours.
    """
    decoder = msgspec.json.Decoder(Heard)
    return [decoder.decode(line) for line in path.read_bytes().split(b"\n")[:-1]]
