"""A tap on a line: sees every byte in both directions, and the events of the line.

The black box of the daemon is one. A tap must not raise, block or wait.
"""

from __future__ import annotations

from typing import Any, Protocol

from yahboomd.core.link.port import Port
from yahboomd.core.model import EncoderReading


class Tap(Protocol):
    """Callbacks of a line, in the order of the events."""

    @property
    def due(self) -> bool:
        """Whether :meth:`settled` is to be called."""

    def opened(self, port: str, byte_ns: int) -> None:
        """A port was opened; ``byte_ns`` is the time of a byte on its wire."""

    def received(self, data: bytes, now_ns: int) -> None:
        """Bytes came in one read, at this moment; they are not used yet."""

    def settled(self) -> None:
        """All input was used, and no part of a frame is left."""

    def noted(self, reading: EncoderReading) -> None:
        """A reading follows whose bytes do not show all of it: it was asked for, or has a flag."""

    def written(self, data: bytes) -> None:
        """Bytes were written."""

    def identified(self, dialect: str, settings: dict[str, Any] | None) -> None:
        """The board is known and its counts are used from here on."""

    def closed(self) -> None:
        """The port was closed."""


class _NoTap:
    due = False

    def _ignore(self, *_: object, **__: object) -> None:
        return

    opened = received = settled = noted = written = identified = closed = _ignore


NO_TAP: Tap = _NoTap()
"""Sees nothing."""


class TappedPort:
    """A port whose output goes to a tap as well; the line itself passes the input to the tap."""

    def __init__(self, port: Port, tap: Tap) -> None:
        self._write = port.write
        self._written = tap.written
        self.name = port.name
        self.byte_ns = port.byte_ns
        # All but the writing is the port's own.
        self.queued = port.queued
        self.listen, self.drop_input = port.listen, port.drop_input
        self.discard, self.drain, self.close = port.discard, port.drain, port.close

    def write(self, data: bytes) -> None:
        self._write(data)
        self._written(data)
