"""Getting to know a board, in an order that is safe if its wheels still turn after a crash.

Stop first (the session has done that), then ask who it is, then how it is set up. Nothing is
written to its flash, ever, by connecting.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable, Iterable

import msgspec

from yahboomd.clock import Clock, nanoseconds, sleep_until
from yahboomd.errors import BoardError, BoardSilent
from yahboomd.link.port import Port
from yahboomd.link.reception import Ears
from yahboomd.link.writer import Writer
from yahboomd.protocol.dialect import (
    Decoded,
    Dialect,
    Item,
    Setting,
    SettingValue,
    VersionLine,
)
from yahboomd.protocol.registry import DIALECTS
from yahboomd.protocol.registry import identify as recognise
from yahboomd.protocol.settings import VERSION, BoardSettings, is_complete

ATTEMPTS = 3
"""How often a silent board is asked who it is."""

ANSWER_WITHIN_S = 0.25
"""The longest answer is begun in under 20 ms and takes 15 ms more."""

QUIET_S = 0.02
QUIET_WITHIN_S = 0.1

SETTINGS_WITHIN_S = 0.2

SETTINGS_ATTEMPTS = 10


class Identity(msgspec.Struct, frozen=True, kw_only=True):
    """What a board turned out to be.

    Attributes:
        dialect: How it is spoken to.
        settings: What it keeps in flash; ``None`` where it cannot be asked.
    """

    dialect: Dialect
    settings: BoardSettings | None


async def identify(
    port: Port,
    clock: Clock,
    wanted: str,
    hear: Callable[[Ears | None], None],
) -> Dialect:
    """Find out which dialect the board speaks.

    Args:
        port: The open port; a stop was sent.
        clock: What tells the time.
        wanted: ``auto``, or the only dialect to accept.
        hear: Sets (or clears) who hears what comes.

    Raises:
        BoardSilent: Nothing answered like a board.
        BoardError: It answered in the other dialect than the configured one.
    """
    items: list[tuple[str, Item]] = []
    news = asyncio.Event()

    def ears(found_by: str, item: Item) -> None:
        items.append((found_by, item))
        news.set()

    hear(ears)
    try:
        # Boards that report by themselves first: what others are asked might not suit them.
        name = None
        if listen_ns := max(dialect.listen_ns for dialect in DIALECTS.values()):
            name = await _recognised(items, news, clock, clock.now_ns() + listen_ns)
        questions = [each.resync + each.probe for each in DIALECTS.values() if each.probe]
        for question in questions * ATTEMPTS:
            if name is not None:
                break
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
            # The board is deaf until it has said all of its answer.
            await _quiet(news, clock)
            return DIALECTS[name]
    finally:
        hear(None)
    counts = Counter(found_by for found_by, _ in items)
    heard = f"{max(counts.values())} lines that are none of a board's" if items else "nothing"
    titles = " or ".join(dict.fromkeys(dialect.title for dialect in DIALECTS.values()))
    raise BoardSilent(
        f"{port.name}: no board answers here; heard {heard}.",
        remedy=f"Is it powered, is this its port, is the baud rate the board's, is it a {titles}? "
        "No counts come, so whether its wheels stand is unknown: look at them.",
    )


async def _recognised(
    items: list[tuple[str, Item]], news: asyncio.Event, clock: Clock, deadline_ns: int
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


async def _quiet(news: asyncio.Event, clock: Clock) -> None:
    """Until nothing more comes; or not for ever, where a stream runs on."""
    end_ns = clock.now_ns() + nanoseconds(QUIET_WITHIN_S)
    while clock.now_ns() < end_ns:
        news.clear()
        await sleep_until(clock, clock.now_ns() + nanoseconds(QUIET_S))
        if not news.is_set():
            return


async def read_settings(
    writer: Writer,
    dialect: Dialect,
    expected: BoardSettings,
    port_name: str,
    heard: Iterable[Decoded] = (),
) -> BoardSettings | None:
    """What the board keeps in flash; ``None`` for a dialect that cannot tell.

    An answer may have no check of any kind, and a lost digit that makes 1 encoder line of 11 turns
    the wheels eleven times too fast. So a value that speed depends on is believed when it is the
    expected one, or when it was said twice.

    Args:
        writer: Asks.
        dialect: How the board is spoken to.
        expected: What a board that was set up for these motors says.
        port_name: For messages.
        heard: What it has said already.

    Raises:
        BoardSilent: It was asked often enough and did not answer all questions.
    """
    if not dialect.read_settings:
        return None
    votes: Counter[tuple[str, SettingValue]] = Counter()

    def hear(decoded: Decoded) -> bool:
        if isinstance(decoded, Setting):
            votes[decoded.name, decoded.value] += 1
        elif isinstance(decoded, VersionLine):
            votes[VERSION, decoded.version] += 1
        return isinstance(decoded, Setting | VersionLine) and decoded.last

    for decoded in heard:
        hear(decoded)
    for _ in range(SETTINGS_ATTEMPTS):
        settings = _believed(dialect, votes, expected)
        if is_complete(dialect.settings, settings):
            return settings
        for question in dialect.read_settings:
            await writer.request(question, hear, SETTINGS_WITHIN_S)
    raise BoardSilent(
        f"{port_name}: the board does not tell its settings, and without them no wheel may turn.",
        remedy="Is the cable long or noisy? Try `yahboomd probe`.",
    )


def _believed(
    dialect: Dialect, votes: Counter[tuple[str, SettingValue]], expected: BoardSettings
) -> BoardSettings:
    steering = {row.field for row in dialect.settings if row.steers}
    # The most said last, so that it stays.
    return {
        name: value
        for (name, value), count in sorted(votes.items(), key=lambda vote: vote[1])
        if name not in steering or count >= 2 or value == expected.get(name)
    }
