"""A conversation with a board that nothing drives: to stop it, and to store settings.

A session keeps a connection alive; a conversation has a beginning and an end. It stops the wheels
before it asks anything, and in every case its line leaves with the motors released.
"""

from __future__ import annotations

from typing import Self

from yahboomd.core.link import handshake
from yahboomd.core.link.line import Line
from yahboomd.core.link.stopping import StopReport
from yahboomd.core.protocol.dialect import Dialect
from yahboomd.core.protocol.settings import BoardSettings


class Conversation:
    """A known board on an attended line."""

    def __init__(self, line: Line, dialect: Dialect) -> None:
        self.line = line
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

    async def read_settings(self, expected: BoardSettings) -> BoardSettings | None:
        """The settings that the board stores; None for a dialect that stores nothing.

        Args:
            expected: A value that differs from it is believed when it was sent twice.

        Raises:
            BoardSilent: The board does not send them.
        """
        return await handshake.read_settings(self.line, self.dialect, expected)

    async def rest(self) -> StopReport:
        """Bring the wheels to rest and release the motors; streams are off afterwards."""
        return await self.line.rest(self.dialect)
