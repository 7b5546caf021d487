"""What comes in: from the port's chunks to what the board said, one thing after the other."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from yahboomd.link.gathering import Gathering
from yahboomd.link.port import Port
from yahboomd.protocol.dialect import Decoded, Dialect, FramerCounters, Item, Totals
from yahboomd.protocol.registry import DIALECTS

KEPT_ITEMS = 256
"""Of what comes before the dialect is known the latest so many are kept."""

Ears = Callable[[str, Item], None]
"""Hears what the framer of a dialect, named first, has found."""

Understand = Callable[[Decoded, Item, int], None]
"""Takes what the board said, the frame or line that it said it in, and when its chunk came."""


class Reception:
    """Cuts, decodes and hands on.

    Args:
        understand: Takes what the board said, once its dialect is known.

    Until the dialect is known the framers of all of them cut the same bytes.

    Attributes:
        ears: Hears frames and lines of every dialect before one is known, to find it out.
    """

    def __init__(self, understand: Understand) -> None:
        self._understand = understand
        self._framers = {name: dialect.framer() for name, dialect in DIALECTS.items()}
        self._framer = next(iter(self._framers.values()))
        self._dialect: Dialect | None = None
        self._port: Port | None = None
        self._gathering: Gathering | None = None
        self._before: deque[tuple[str, Item]] = deque(maxlen=KEPT_ITEMS)
        self.ears: Ears | None = None

    def choose(self, dialect: Dialect) -> list[Decoded]:
        """Decode in this dialect from now on.

        Returns:
            What the board has said before, which could not be understood.
        """
        self._dialect = dialect
        self._framer = self._framers[dialect.name]
        before, self._before = self._before, deque(maxlen=0)
        return [dialect.decode(item) for found_by, item in before if found_by == dialect.name]

    @property
    def counters(self) -> FramerCounters:
        """The framer's."""
        return self._framer.counters

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
        assert self._dialect is not None
        self._port, self._gathering = port, Gathering(len(self._dialect.line_end))

    def stop_gathering(self) -> None:
        """Every byte is to be heard as it comes."""
        if self._port is not None:
            self._port.gather(1)
        self._port = self._gathering = None

    def take(self, data: bytes, now_ns: int) -> None:
        """A chunk came from the port."""
        dialect, gathering = self._dialect, self._gathering
        if dialect is None:
            self._listen(data)
            return
        for item in self._framer.feed(data):
            decoded = dialect.decode(item)
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

    def _listen(self, data: bytes) -> None:
        for name, framer in self._framers.items():
            for item in framer.feed(data):
                self._before.append((name, item))
                if self.ears is not None:
                    self.ears(name, item)
