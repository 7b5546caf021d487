"""The host's bytes and their times, to measure stop latencies.

A file of JSON lines, one for each read of the port, flushed at once. Stamps are CLOCK_MONOTONIC at
the moment the bytes had left the host's write, before the simulated wire delays them.
"""

from __future__ import annotations

from pathlib import Path

import msgspec

from yahboomd.simulation.lines import LinesWriter, read_lines


class HostBytes(msgspec.Struct, frozen=True, kw_only=True):
    """Bytes of the host.

    Attributes:
        t_ns: Monotonic nanoseconds.
        data: The bytes as Latin-1 text: each character is one byte.
    """

    t_ns: int
    data: str


class HeardWriter(LinesWriter):
    """Writes the bytes of the host to a file; :meth:`note` fits a port's ``on_heard``."""

    def note(self, data: bytes, t_ns: int) -> None:
        """Append bytes; nothing after :meth:`close`."""
        self.write(HostBytes(t_ns=t_ns, data=data.decode("latin-1")))


def read_heard(path: Path) -> list[HostBytes]:
    """All of it, oldest first; see :func:`~yahboomd.simulation.lines.read_lines`."""
    return read_lines(path, HostBytes)
