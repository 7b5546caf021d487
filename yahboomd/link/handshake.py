"""Getting to know a board, in an order that is safe if its wheels still turn after a crash.

Stop first (the session has done that), then ask who it is, then how it is set up. Nothing is
written to its flash, ever, by connecting.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import msgspec

from yahboomd.clock import Clock, nanoseconds
from yahboomd.errors import BoardError, BoardSilent
from yahboomd.link.port import Port
from yahboomd.link.writer import Writer
from yahboomd.protocol.dialect import Decoded, Dialect
from yahboomd.protocol.framing import RESYNC, Frame, TextLine
from yahboomd.protocol.registry import DIALECTS
from yahboomd.protocol.registry import identify as recognise
from yahboomd.protocol.settings import BoardSettings, board_settings

ATTEMPTS = 3
"""How often a silent board is asked who it is."""

ANSWER_WITHIN_S = 0.25
"""The longest answer, ``$read_flash#``'s, is begun in under 20 ms and takes 15 ms more."""

SETTINGS_WITHIN_S = 0.4

Ears = Callable[[Frame | TextLine], None]


class Identity(msgspec.Struct, frozen=True, kw_only=True):
    """What a board turned out to be.

    Attributes:
        dialect: How it is spoken to.
        settings: What it keeps in flash; ``None`` where it cannot be asked.
    """

    dialect: Dialect
    settings: BoardSettings | None


async def identify(
    port: Port, clock: Clock, wanted: str, hear: Callable[[Ears | None], None]
) -> Dialect:
    """Find out which dialect the board speaks.

    Args:
        port: The open port; the wheels were told to stop.
        clock: What tells the time.
        wanted: ``auto``, or the only dialect to accept.
        hear: Sets (or clears) who hears what comes.

    Raises:
        BoardSilent: Nothing answered like a board.
        BoardError: It answered in the other dialect than the configured one.
    """
    items: list[Frame | TextLine] = []
    news = asyncio.Event()

    def ears(item: Frame | TextLine) -> None:
        items.append(item)
        news.set()

    hear(ears)
    try:
        for _ in range(ATTEMPTS):
            for dialect in DIALECTS.values():
                question = RESYNC + dialect.probe
                port.write(question)
                sent_ns = len(question) * port.byte_ns
                deadline_ns = clock.now_ns() + sent_ns + nanoseconds(ANSWER_WITHIN_S)
                name = await _recognised(items, news, clock, deadline_ns)
                if name is not None:
                    if wanted not in {"auto", name}:
                        raise BoardError(
                            f"{port.name}: the board speaks the {name} dialect, and the "
                            f"configuration says {wanted}.",
                            remedy=f'Set serial.dialect = "auto" or "{name}".',
                        )
                    return DIALECTS[name]
    finally:
        hear(None)
    heard = f"{len(items)} lines that are none of a board's" if items else "nothing"
    raise BoardSilent(
        f"{port.name}: no board answers here; heard {heard}.",
        remedy="Is it powered, is this its port, is the baud rate 115200, is it a Yahboom "
        "4-channel driver? The wheels stay stopped.",
    )


async def _recognised(
    items: list[Frame | TextLine], news: asyncio.Event, clock: Clock, deadline_ns: int
) -> str | None:
    """The dialect, as soon as what was heard tells it."""
    alarm = clock.alarm(news.set)
    alarm.set(deadline_ns)
    try:
        while True:
            name = recognise(items)
            if name is not None or clock.now_ns() >= deadline_ns:
                return name
            news.clear()
            await news.wait()
    finally:
        alarm.close()


async def read_settings(writer: Writer, dialect: Dialect, port_name: str) -> BoardSettings | None:
    """What the board keeps in flash; ``None`` for a dialect that cannot tell.

    Raises:
        BoardSilent: It was asked three times and never told everything.
    """
    if dialect.read_settings is None:
        return None
    for _ in range(ATTEMPTS):
        said: list[Decoded] = []

        def complete(decoded: Decoded, said: list[Decoded] = said) -> bool:
            said.append(decoded)
            return board_settings(said).is_complete

        if await writer.request(dialect.read_settings, complete, SETTINGS_WITHIN_S):
            return board_settings(said)
    raise BoardSilent(
        f"{port_name}: the board does not tell its settings, and without them no wheel may turn.",
        remedy="Is the cable long or noisy? Try `yahboomd probe`.",
    )
