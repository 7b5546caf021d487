"""Identifies a board, in an order that is safe if its wheels still turn after a crash.

Stop first, then identify it, then read its settings. Connecting never writes to its flash.
"""

from __future__ import annotations

from collections import Counter

import msgspec

from yahboomd.core.clock import nanoseconds, sleep_until
from yahboomd.core.errors import BoardError, BoardSilent
from yahboomd.core.link.line import Line
from yahboomd.core.link.port_errors import other_readers, takes_no_output
from yahboomd.core.link.stopping import stop_unidentified
from yahboomd.core.protocol.dialect import Battery, Decoded, Dialect, Setting, Totals, VersionLine
from yahboomd.core.protocol.registry import DIALECTS, unknown_dialect
from yahboomd.core.protocol.registry import identify as recognise
from yahboomd.core.protocol.settings import VERSION, BoardSettings, SettingValue, is_complete

ATTEMPTS = 3
"""The number of times that a silent board is asked to identify itself."""

ANSWER_WITHIN_S = 0.25
"""The longest answer is begun in under 20 ms and takes 15 ms more."""

QUIET_S = 0.02
QUIET_WITHIN_S = 0.1

REPORT_WITHIN_S = 0.1
"""Twice the period of the reports of any board."""

SETTINGS_WITHIN_S = 0.2

SETTINGS_ATTEMPTS = 10


class Identity(msgspec.Struct, frozen=True, kw_only=True):
    """The dialect and settings of a board.

    Attributes:
        settings: The settings in its flash; ``None`` if it cannot be asked.
    """

    dialect: Dialect
    settings: BoardSettings | None


async def identify(line: Line, wanted: str = "auto", *, stop_first: bool = True) -> Dialect:
    """Stop the wheels, and find out which dialect the board speaks.

    Args:
        wanted: ``auto``, or the only dialect to accept.
        stop_first: The stop of an unknown board has not been sent to it yet.

    Raises:
        BoardSilent: Nothing answered like a board.
        BoardError: It answered in the other dialect than the configured one.
        PortLost: The port takes no output.
    """
    port, clock = line.port, line.clock
    if stop_first and not await stop_unidentified(port, clock):
        raise takes_no_output(port.name)
    first = len(line.unread)
    # Boards that report by themselves first: the questions to others might not suit them.
    name = None
    if listen_ns := max(dialect.listen_ns for dialect in DIALECTS.values()):
        name = await _recognised(line, first, clock.now_ns() + listen_ns)
    questions = [each.resync + each.probe for each in DIALECTS.values() if each.probe]
    for question in questions * ATTEMPTS:
        if name is not None:
            break
        line.notices.asked(clock.now_ns())
        port.write(question)
        sent_ns = len(question) * port.byte_ns
        deadline_ns = clock.now_ns() + sent_ns + nanoseconds(ANSWER_WITHIN_S)
        name = await _recognised(line, first, deadline_ns)
    if name is not None:
        if wanted not in {"auto", name}:
            raise BoardError(
                f"{port.name}: the board uses the {name} dialect, and the "
                f"configuration names {wanted}.",
                remedy=f'Set serial.dialect = "auto" or "{name}".',
            )
        found = DIALECTS[name]
        if found.listen_ns:
            # It may have started just now, with a motion that it received before.
            port.write(found.resync + found.surest_stop)
        # The board receives nothing until its answer is complete.
        await _quiet(line)
        return found
    chatter = max(Counter(found_by for found_by, _ in line.unread[first:]).values(), default=0)
    heard = f"{chatter} lines that no board sends" if chatter else "nothing"
    titles = " or ".join(dict.fromkeys(dialect.title for dialect in DIALECTS.values()))
    slow = "".join(
        f"A {dialect.title} is silent for {dialect.starts_within_s:g} s after it was switched "
        "on or reset. "
        for dialect in DIALECTS.values()
        if dialect.starts_within_s and wanted in {"auto", dialect.name}
    )
    raise BoardSilent(
        f"{port.name}: no board answers here; received {heard}.",
        remedy=unheard_because(
            line, f"Is it powered, is this its port and baud rate, is it a {titles}?"
        )
        + f" {slow}No counts come, so whether its wheels stand is unknown: look at them.",
    )


async def _recognised(line: Line, first: int, deadline_ns: int) -> str | None:
    alarm = line.clock.alarm(line.news.set)
    alarm.set(deadline_ns)
    try:
        while True:
            name = recognise(line.unread[first:])
            if name is not None or line.clock.now_ns() >= deadline_ns:
                return name
            line.news.clear()
            await line.news.wait()
    finally:
        alarm.close()


async def _quiet(line: Line) -> None:
    """Wait until nothing more comes; bounded, because a stream may run on."""
    clock = line.clock
    end_ns = clock.now_ns() + nanoseconds(QUIET_WITHIN_S)
    while clock.now_ns() < end_ns:
        line.news.clear()
        await sleep_until(clock, clock.now_ns() + nanoseconds(QUIET_S))
        if not line.news.is_set():
            return


async def await_reports(line: Line, dialect: Dialect) -> None:
    """See counts of a board that reports unasked; if none come, switch its reports on.

    Raises:
        BoardSilent: It answers and does not report, with the reason as far as it is known.
    """
    if not dialect.listen_ns or line.streaming:
        return
    # A board that needs no such frame gets the same wait.
    for frame in (dialect.arm or (b"",)) * ATTEMPTS:
        if await line.ask(frame, lambda said: isinstance(said, Totals), REPORT_WITHIN_S):
            return
    volts, stored = await ask_supply(line, dialect)
    if line.heard.resets and volts is None:
        raise BoardSilent(
            f"{line.port.name}: the board was switched on or reset this moment, and reports no "
            "counts yet.",
            remedy=f"It takes up to {dialect.starts_within_s:g} s. Leave it still and level.",
        )
    raise BoardSilent(
        f"{line.port.name}: the board answers, and reports no counts.",
        remedy=unheard_because(line, dialect.silence(volts, stored)),
    )


def unheard_because(
    line: Line, otherwise: str = "Is the cable long or noisy? Try `yahboomd probe`."
) -> str:
    """Why answers are missing: a clone's dialect, another reader of the port, or something else."""
    return unknown_dialect(line.heard.start) or other_readers(line.port.name) or otherwise


async def ask_supply(line: Line, dialect: Dialect) -> tuple[float | None, BoardSettings]:
    """The voltage and the stored values of a silent board, as far as it answers."""
    volts: list[float] = []
    stored: BoardSettings = {}

    def answered(said: Decoded) -> bool:
        if isinstance(said, Battery):
            volts.append(said.volts)
        elif isinstance(said, Setting):
            stored[said.name] = said.value
        return isinstance(said, Battery | Setting | VersionLine)

    for question in filter(None, (dialect.battery, *dialect.read_settings)):
        await line.ask(question, answered, ANSWER_WITHIN_S)
    return (volts[-1] if volts else None), stored


async def read_settings(
    line: Line, dialect: Dialect, expected: BoardSettings
) -> BoardSettings | None:
    """The settings that the board keeps in flash; ``None`` for a dialect that reports none.

    An answer may have no check of any kind, and a lost digit that makes 1 encoder line of 11 turns
    the wheels eleven times too fast. So a value that speed depends on is believed when it is the
    expected one, or when it was sent twice.

    Args:
        expected: The settings of a board that was set up for these motors.

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

    # Its answers to the first question count once, and settings may be among them.
    said, line.said = line.said, []
    for decoded in said:
        hear(decoded)
    for _ in range(SETTINGS_ATTEMPTS):
        settings = _believed(dialect, votes, expected)
        if is_complete(dialect.settings, settings):
            return settings
        for question in dialect.read_settings:
            line.notices.asked(line.clock.now_ns())
            await line.ask(question, hear, SETTINGS_WITHIN_S)
    raise BoardSilent(
        f"{line.port.name}: the board does not send its settings, and without them no wheel may "
        "turn.",
        remedy=unheard_because(line),
    )


def _believed(
    dialect: Dialect, votes: Counter[tuple[str, SettingValue]], expected: BoardSettings
) -> BoardSettings:
    steering = {row.field for row in dialect.settings if row.steers}
    # The most frequent value last, so that it stays.
    return {
        name: value
        for (name, value), count in sorted(votes.items(), key=lambda vote: vote[1])
        if name not in steering or count >= 2 or value == expected.get(name)
    }
