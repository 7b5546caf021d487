"""Storing settings on the board: one value at a time, each confirmed, the wheels at rest.

An answer is no proof (some boards give none, and a lost one looks like a failure), so every
value is read back, and that decides. The board is deaf while it writes, and some flash chips store
three of five values that come too fast: each is waited for.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, TypeAlias

import msgspec

from yahboomd.core.clock import Clock, nanoseconds, seconds, sleep_until
from yahboomd.core.errors import BoardError, BoardStoresNothing
from yahboomd.core.link import handshake
from yahboomd.core.link.conversation import Conversation
from yahboomd.core.link.line import Line
from yahboomd.core.link.port import Opener
from yahboomd.core.link.tap import NO_TAP, Tap
from yahboomd.core.protocol.dialect import CommandLost, Decoded, Dialect, Reply, VersionLine
from yahboomd.core.protocol.settings import BoardSettings, SettingWrite
from yahboomd.core.protocol.settings import writes as settings_writes

Outcome: TypeAlias = Literal["stored", "refused", "failed"]

STORE_ATTEMPTS = 3

START_LOOK_S = 0.5
START_SPARE_S = 2.0
"""How much longer than its usual start a board is waited for."""


class StoringStep(msgspec.Struct, frozen=True, kw_only=True):
    """One value to be stored.

    Attributes:
        write: The frame that was sent.
        outcome: Read back as wanted; refused in words; or neither.
        answer: The board's answer; empty if none came.
        took_s: From the first attempt until it was read back.
    """

    write: SettingWrite
    outcome: Outcome
    answer: str
    attempts: int
    took_s: float


class Storing(msgspec.Struct, frozen=True, kw_only=True):
    """The outcome of storing.

    Attributes:
        steps: The values, in the order in which they were sent; the first that is not stored is
            the last that was tried.
    """

    had: BoardSettings
    has: BoardSettings
    steps: tuple[StoringStep, ...]

    @property
    def complete(self) -> bool:
        return all(step.outcome == "stored" for step in self.steps)


class Progress:
    """Receives the progress of storing; override the calls of interest."""

    def begins(
        self, dialect: Dialect, writes: tuple[SettingWrite, ...], had: BoardSettings
    ) -> None:
        """The values that differ and will be stored."""

    def stored(self, step: StoringStep, has: BoardSettings) -> None:
        """One value was dealt with; the board stores ``has`` now."""


async def store(
    opener: Opener,
    clock: Clock,
    want: BoardSettings,
    progress: Progress | None = None,
    tap: Tap = NO_TAP,
) -> Storing:
    """Store the values that differ, one by one.

    Args:
        want: The values that the board shall store; others are left alone.

    Raises:
        BoardStoresNothing: The board's dialect has no settings.
        BoardError: Its wheels are not seen to stand.
        ConfigError: A wanted value must never be stored.
        LinkError: The port cannot be opened, went away, or the board fell silent.
    """
    progress = progress or Progress()
    line = Line(await opener(), clock, tap=tap)
    async with line.attended():
        talk = await Conversation.begin(line)
        dialect = talk.dialect
        if not dialect.read_settings:
            raise BoardStoresNothing(
                f"{line.port.name}: a board of the {dialect.name} dialect stores no settings."
            )
        had = await _read(talk, want)
        writes = settings_writes(dialect.settings, had, want)
        progress.begins(dialect, writes, had)
        has = had
        steps: list[StoringStep] = []
        held = bool(writes) and await _stand(talk, line.port.name)
        for write in writes:
            step, has = await _store_one(talk, clock, write, want, restarts=held)
            held = held and step.outcome != "stored"
            steps.append(step)
            progress.stored(step, has)
            if step.outcome != "stored":
                break
        return Storing(had=had, has=has, steps=tuple(steps))


async def _stand(talk: Conversation, port: str) -> bool:
    """See the wheels stand, with the motors released and the streams off.

    Returns:
        Whether an alarm of the board holds them, which ends with the next reset.
    """
    report = await talk.rest()
    if report.stood is None:
        supply = await handshake.ask_supply(talk.line, talk.dialect)
        if talk.dialect.brakes_until_reset(*supply):
            return True
    if report.stood is not True:
        seen = "the wheels turn" if report.stood is False else "the counters do not come"
        raise BoardError(
            f"{port}: settings are stored with the wheels at rest only, and {seen}.",
            remedy="Nothing was stored. Hold the robot still and try again.",
        )
    return False


async def _read(talk: Conversation, want: BoardSettings) -> BoardSettings:
    settings = await talk.read_settings(want)
    assert settings is not None, "the dialect can tell"
    return settings


async def _store_one(
    talk: Conversation, clock: Clock, write: SettingWrite, want: BoardSettings, *, restarts: bool
) -> tuple[StoringStep, BoardSettings]:
    """Store one value and read it back.

    Args:
        restarts: An alarm holds the board, and a value that it takes restarts it.
    """
    start_ns = clock.now_ns()
    answer = ""
    outcome: Outcome = "failed"
    attempts = 0
    while True:
        attempts += 1
        said: list[Decoded] = []
        # A board sends its settings twice, on two ports; lost gains make a long line of them.
        await sleep_until(clock, clock.now_ns() + talk.dialect.spacing_ns)
        await talk.line.ask(write.frame, _answers(write, said), write.timeout_s)
        answer = _words(said) or answer
        if restarts:
            await _started(talk, clock)
        # The answer does not decide: the stored value does.
        has = await _read(talk, want)
        if write not in settings_writes(talk.dialect.settings, has, want):
            outcome = "stored"
        elif any(isinstance(each, Reply) and not each.ok for each in said):
            outcome = "refused"
        if outcome != "failed" or attempts == STORE_ATTEMPTS:
            break
    took_s = seconds(clock.now_ns() - start_ns)
    step = StoringStep(
        write=write, outcome=outcome, answer=answer, attempts=attempts, took_s=took_s
    )
    return step, has


async def _started(talk: Conversation, clock: Clock) -> None:
    """Wait until the board answers again; it is silent while it starts."""
    question = talk.dialect.probe or b""
    until_ns = clock.now_ns() + nanoseconds(talk.dialect.starts_within_s + START_SPARE_S)

    def answered(said: Decoded) -> bool:
        return isinstance(said, VersionLine) and not said.after_reset

    while not await talk.line.ask(question, answered, START_LOOK_S):
        if clock.now_ns() >= until_ns:
            return


def _answers(write: SettingWrite, said: list[Decoded]) -> Callable[[Decoded], bool]:
    def answered(decoded: Decoded) -> bool:
        relevant = (
            (isinstance(decoded, Reply) and (decoded.command == write.reply_to or not decoded.ok))
            or isinstance(decoded, CommandLost)
            or (write.resets and isinstance(decoded, VersionLine))
        )
        if relevant:
            said.append(decoded)
        return relevant

    return answered


def _words(said: list[Decoded]) -> str:
    for decoded in said:
        if isinstance(decoded, Reply | CommandLost):
            return decoded.text
        if isinstance(decoded, VersionLine):
            return "restarted"
    return ""
