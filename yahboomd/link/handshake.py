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
from yahboomd.link.writer import Writer
from yahboomd.protocol.dialect import Decoded, Dialect, Setting, SettingValue, VersionLine
from yahboomd.protocol.framing import RESYNC, Frame, TextLine
from yahboomd.protocol.registry import DIALECTS
from yahboomd.protocol.registry import identify as recognise
from yahboomd.protocol.settings import BoardSettings

ATTEMPTS = 3
"""How often a silent board is asked who it is."""

ANSWER_WITHIN_S = 0.25
"""The longest answer, ``$read_flash#``'s, is begun in under 20 ms and takes 15 ms more."""

QUIET_S = 0.02
QUIET_WITHIN_S = 0.1

SETTINGS_WITHIN_S = 0.2

SETTINGS_ATTEMPTS = 10

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
    port: Port,
    clock: Clock,
    wanted: str,
    hear: Callable[[Ears | None], None],
    said: list[Decoded] | None = None,
) -> Dialect:
    """Find out which dialect the board speaks.

    Args:
        port: The open port; a stop was sent.
        clock: What tells the time.
        wanted: ``auto``, or the only dialect to accept.
        hear: Sets (or clears) who hears what comes.
        said: Takes what the board said on being asked: its settings may be among it.

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
                    # The board is deaf until it has said all of its answer.
                    await _quiet(news, clock)
                    if said is not None:
                        said.extend(map(DIALECTS[name].decode, items))
                    return DIALECTS[name]
    finally:
        hear(None)
    heard = f"{len(items)} lines that are none of a board's" if items else "nothing"
    raise BoardSilent(
        f"{port.name}: no board answers here; heard {heard}.",
        remedy="Is it powered, is this its port, is the baud rate 115200, is it a Yahboom "
        "4-channel driver? No counts come, so whether its wheels stand is unknown: look at them.",
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

    The answer has no check of any kind, and a lost digit makes ``Pulse_Line:1`` of 11: the wheels
    would turn eleven times too fast. So a value that speed depends on is believed when it is the
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
    if dialect.read_settings is None:
        return None
    votes: Counter[tuple[str, SettingValue | str]] = Counter()

    def hear(decoded: Decoded) -> bool:
        if isinstance(decoded, Setting):
            votes[decoded.name, decoded.value] += 1
        elif isinstance(decoded, VersionLine):
            votes["version", decoded.version] += 1
        # The gains are the answer's last line, whatever became of the others.
        return isinstance(decoded, Setting) and decoded.name == "pid"

    for decoded in heard:
        hear(decoded)
    for _ in range(SETTINGS_ATTEMPTS):
        settings = _believed(votes, expected)
        if settings.is_complete:
            return settings
        await writer.request(dialect.read_settings, hear, SETTINGS_WITHIN_S)
    raise BoardSilent(
        f"{port_name}: the board does not tell its settings, and without them no wheel may turn.",
        remedy="Is the cable long or noisy? Try `yahboomd probe`.",
    )


def _believed(
    votes: Counter[tuple[str, SettingValue | str]], expected: BoardSettings
) -> BoardSettings:
    settings = BoardSettings()
    # The most said last, so that it stays.
    for (name, value), count in sorted(votes.items(), key=lambda vote: vote[1]):
        if name not in _SPEED_DEPENDS_ON or count >= 2 or value == getattr(expected, name):
            settings = settings.with_value(name, value)
    return settings


_SPEED_DEPENDS_ON = frozenset({"motor_type", "lines", "ratio", "wheel_diameter_mm"})
