"""Questions to a board that nothing drives: for `stop`, `probe`, and settings that are stored.

A session keeps a connection alive; a conversation has a beginning and an end. It stops the wheels
before it asks anything, and in every case its line leaves with the motors released.
"""

from __future__ import annotations

from typing import Self

from yahboomd.core.link import handshake
from yahboomd.core.link.line import Line
from yahboomd.core.link.outbox import Answers
from yahboomd.core.link.stopping import StopReport
from yahboomd.core.model import Counts
from yahboomd.core.protocol.dialect import Battery, Decoded, Dialect, Totals
from yahboomd.core.protocol.settings import BoardSettings

ASK_ATTEMPTS = 3
COUNTERS_WITHIN_S = 0.1
BATTERY_WITHIN_S = 0.15


class Conversation:
    """A known board on an attended line."""

    def __init__(self, line: Line, dialect: Dialect) -> None:
        self._line = line
        self.dialect = dialect

    @classmethod
    async def begin(cls, line: Line, *, stop_first: bool = True) -> Self:
        """Stop the wheels, and find out which board is there.

        Args:
            stop_first: The stop of an unknown board has not been sent on it yet.

        Raises:
            BoardSilent: Nothing answered like a board.
            PortLost: The port takes no output.
        """
        dialect = await handshake.identify(line, stop_first=stop_first)
        line.understand(dialect, spacing_ns=dialect.spacing_ns)
        return cls(line, dialect)

    async def request(self, frame: bytes, answered: Answers, timeout_s: float) -> bool:
        """Send one frame and wait for its answer; return whether it came."""
        return await self._line.ask(frame, answered, timeout_s)

    async def read_settings(self, expected: BoardSettings) -> BoardSettings | None:
        """The settings that the board stores; None for a dialect that stores nothing.

        Args:
            expected: A value that differs from it is believed when it was sent twice.

        Raises:
            BoardSilent: The board does not send them.
        """
        return await handshake.read_settings(self._line, self.dialect, expected)

    async def read_battery(self) -> float | None:
        """The voltage of the motors' supply; None if the board does not report it."""
        volts: list[float] = []

        def answered(said: Decoded) -> bool:
            if isinstance(said, Battery):
                volts.append(said.volts)
            return bool(volts)

        if self.dialect.battery is not None:
            for _ in range(ASK_ATTEMPTS):
                if await self.request(self.dialect.battery, answered, BATTERY_WITHIN_S):
                    return volts[-1]
        return None

    async def why_silent(self) -> str:
        """The reason why no counts come although the board answers; empty if there is none."""
        return self.dialect.silence(*await handshake.ask_supply(self._line, self.dialect))

    async def read_counters(self) -> Counts | None:
        """The counters now; None if they do not come. A stream is left switched on."""
        frames = self.dialect.arm if self.dialect.poll is None else (self.dialect.poll,)
        for _ in range(ASK_ATTEMPTS):
            # A board that counts unasked gets no question, but the wait is the same.
            for frame in frames or (b"",):
                if await self.request(frame, _is_totals, COUNTERS_WITHIN_S):
                    return self._line.ticks
        return None

    async def rest(self) -> StopReport:
        """Bring the wheels to rest and release the motors; streams are off afterwards."""
        return await self._line.rest(self.dialect)


def _is_totals(said: Decoded) -> bool:
    return isinstance(said, Totals)
