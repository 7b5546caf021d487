"""Questions of the commands to a board: its counters, its supply, and why it does not count."""

from __future__ import annotations

from yahboomd.core.link import handshake
from yahboomd.core.link.conversation import Conversation
from yahboomd.core.model import Counts
from yahboomd.core.protocol.dialect import Battery, Decoded, Totals

ATTEMPTS = 3
COUNTERS_WITHIN_S = 0.1
BATTERY_WITHIN_S = 0.15


async def read_battery(talk: Conversation) -> float | None:
    """The voltage of the motors' supply; None if the board does not report it."""
    volts: list[float] = []

    def answered(said: Decoded) -> bool:
        if isinstance(said, Battery):
            volts.append(said.volts)
        return bool(volts)

    if talk.dialect.battery is not None:
        for _ in range(ATTEMPTS):
            if await talk.line.ask(talk.dialect.battery, answered, BATTERY_WITHIN_S):
                return volts[-1]
    return None


async def why_silent(talk: Conversation) -> str:
    """The reason why no counts come although the board answers; empty if there is none."""
    return talk.dialect.silence(*await handshake.ask_supply(talk.line, talk.dialect))


async def read_counters(talk: Conversation) -> Counts | None:
    """The counters now; None if they do not come. A stream is left switched on."""
    dialect = talk.dialect
    frames = dialect.arm if dialect.poll is None else (dialect.poll,)
    for _ in range(ATTEMPTS):
        # A board that counts unasked gets no question, but the wait is the same.
        for frame in frames or (b"",):
            if await talk.line.ask(frame, _is_totals, COUNTERS_WITHIN_S):
                return talk.line.ticks
    return None


def _is_totals(said: Decoded) -> bool:
    return isinstance(said, Totals)
