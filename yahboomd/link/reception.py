"""What comes in: from the port's chunks to what the board said, one thing after the other."""

from __future__ import annotations

from collections.abc import Callable

from yahboomd.link.gathering import Gathering
from yahboomd.link.port import Port
from yahboomd.protocol.dialect import Decoded, Dialect, Totals
from yahboomd.protocol.framing import Frame, Framer, TextLine

Understand = Callable[[Decoded, Frame | TextLine, int], None]
"""Takes what the board said, the frame or line that it said it in, and when its chunk came."""


class Reception:
    """Cuts, decodes and hands on.

    Args:
        understand: Takes what the board said, once its dialect is known.

    Attributes:
        dialect: What it is decoded with; nothing is, before it is known.
        ears: Hears frames and lines before they are decoded, to find out the dialect.
    """

    def __init__(self, understand: Understand) -> None:
        self._understand = understand
        self._framer = Framer()
        self._port: Port | None = None
        self._gathering: Gathering | None = None
        self._last: tuple[str, str, Decoded] | None = None
        self.dialect: Dialect | None = None
        self.ears: Callable[[Frame | TextLine], None] | None = None

    def facts(self) -> dict[str, int]:
        """The framer's counters."""
        counters = self._framer.counters
        return {name: getattr(counters, name) for name in counters.__struct_fields__}

    @property
    def damage(self) -> int:
        """How often something came in that the line has damaged."""
        seen = self._framer.counters
        return seen.broken_frames + seen.discarded_bytes + seen.overlong + seen.bad_bytes

    def gather(self, port: Port) -> None:
        """Counts come in a known dialect from now on: whole lines of them may be waited for."""
        assert self.dialect is not None
        self._port, self._gathering = port, Gathering(len(self.dialect.line_end))

    def stop_gathering(self) -> None:
        """Every byte is to be heard as it comes."""
        if self._port is not None:
            self._port.gather(1)
        self._port = self._gathering = None

    def take(self, data: bytes, now_ns: int) -> None:
        """A chunk came from the port."""
        gathering = self._gathering
        for item in self._framer.feed(data):
            if self.ears is not None:
                self.ears(item)
            if self.dialect is None:
                continue
            decoded = self._decode(self.dialect, item)
            self._understand(decoded, item, now_ns)
            if (
                gathering is not None
                and isinstance(decoded, Totals)
                and gathering.line(item.size, item.trailing)
            ):
                self._tell_port()
        if gathering is not None and gathering.rest(self._framer.held_bytes):
            self._tell_port()

    def _tell_port(self) -> None:
        # What was just understood may have ended the session.
        if self._port is not None and self._gathering is not None:
            self._port.gather(self._gathering.least)

    def _decode(self, dialect: Dialect, item: Frame | TextLine) -> Decoded:
        if isinstance(item, TextLine):
            return dialect.decode(item)
        # A board that streams says the same counts two to four times.
        last = self._last
        if last is not None and item.args == last[1] and item.name == last[0]:
            return last[2]
        decoded = dialect.decode(item)
        self._last = (item.name, item.args, decoded)
        return decoded
