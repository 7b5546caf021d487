"""Examines a board, and finds out whether opening the port resets it. No wheel moves."""

from __future__ import annotations

from typing import Literal, TypeAlias

import msgspec

from yahboomd.core.clock import Clock
from yahboomd.core.counts import unwrapped
from yahboomd.core.errors import BoardSilent
from yahboomd.core.link.conversation import Conversation
from yahboomd.core.link.line import Line, ReceivedSample
from yahboomd.core.link.port import Opener
from yahboomd.core.link.port_errors import other_readers
from yahboomd.core.model import Counts
from yahboomd.core.protocol.dialect import Dialect
from yahboomd.core.protocol.settings import BoardSettings
from yahboomd.tools.port.board_questions import read_battery, read_counters, why_silent

Survival: TypeAlias = Literal["kept", "reset", "unknown"]

DRIFT_TICKS = 400
"""A wheel that is pushed between two readings counts: a third of a turn of the usual gear."""


class Examination(msgspec.Struct, frozen=True, kw_only=True):
    """The answers of a board.

    Attributes:
        dialect: The board's dialect; None if nothing answered like a board.
        settings: Its stored settings; None if it stores none, or did not report them.
        volts: The supply of its motors; None if it does not report the voltage.
        ticks: Its counters; None if they did not come.
        standing: Whether the wheels were seen to stand; None if no counts came.
        silence: Why no counts came although the board answers; empty if that is not known.
        readers: Who else has the port open, with the remedy; empty if none was seen.
    """

    dialect: Dialect | None
    settings: BoardSettings | None = None
    volts: float | None = None
    ticks: Counts | None = None
    standing: bool | None = None
    silence: str = ""
    readers: str = ""
    heard: ReceivedSample


async def examine(
    opener: Opener, clock: Clock, expected: BoardSettings, *, counters_only: bool = False
) -> Examination:
    """Open the port, stop the wheels, ask every question, and close.

    Args:
        expected: The settings that the board should store.
        counters_only: Ask for the counters alone.

    Raises:
        LinkError: The port cannot be opened, or went away.
    """
    line = Line(await opener(), clock)
    async with line.attended():
        try:
            talk = await Conversation.begin(line)
        except BoardSilent:
            return Examination(
                dialect=None, heard=line.heard, readers=other_readers(line.port.name)
            )
        settings, volts = None, None
        if not counters_only:
            try:
                settings = await talk.read_settings(expected)
            except BoardSilent:
                settings = None
            volts = await read_battery(talk)
        ticks = await read_counters(talk)
        silence = await why_silent(talk) if ticks is None else ""
        report = await talk.rest()
        return Examination(
            dialect=talk.dialect,
            settings=settings,
            volts=volts,
            # The newest counters: the wheels may have rolled on since the answer.
            ticks=line.ticks if ticks is not None else None,
            standing=report.stood,
            silence=silence,
            readers=other_readers(line.port.name),
            heard=line.heard,
        )


class Reopening(msgspec.Struct, frozen=True, kw_only=True):
    """The effect on the counters of closing and opening the port.

    Attributes:
        survival: Whether the counters were kept, or the board restarted; unknown if they were
            near zero already, or did not come.
        banner: The board announced a start.
    """

    survival: Survival
    before: Counts | None
    after: Counts | None
    banner: bool

    @property
    def near_zero(self) -> bool:
        """Whether the counters are near zero now, as after a reset."""
        return self.after is not None and _near_zero(self.after)


def compare(before: Counts | None, after: Counts | None, *, banner: bool) -> Reopening:
    """Judge by the counters whether a board was reset between two readings."""
    # A line that loses bytes can turn settings into a banner, so the counters overrule it.
    survival: Survival = "reset" if banner else "unknown"
    if before is not None and after is not None:
        kept = all(_near(a, b) for a, b in zip(before, after, strict=True))
        zero = _near_zero(after)
        if kept != zero:
            survival = "kept" if kept else "reset"
    return Reopening(survival=survival, before=before, after=after, banner=banner)


async def reopen(opener: Opener, clock: Clock, before: Examination) -> Reopening:
    """Open the port once more after it was closed, and compare the counters.

    Raises:
        LinkError: The port cannot be opened, or went away.
    """
    again = await examine(opener, clock, BoardSettings(), counters_only=True)
    return compare(before.ticks, again.ticks, banner=again.heard.resets > 0)


def _near_zero(ticks: Counts) -> bool:
    return all(_near(0, each) for each in ticks)


def _near(a: int, b: int) -> bool:
    return abs(unwrapped(b - a)) <= DRIFT_TICKS
