"""Questions to the person beside the robot, while the robot's loop runs on."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from yahboomd.core.errors import Refused
from yahboomd.tools.terminal.input_lines import InputLines
from yahboomd.tools.terminal.words import decimal


@dataclass(frozen=True, kw_only=True)
class LargestMove:
    """The most that the robot moves before the next question."""

    distance_m: float
    turn_rad: float
    time_s: float


@dataclass(frozen=True)
class Number:
    """A question for a number.

    Attributes:
        name: The question's name, for programs.
        good: Whether a number is possible.
        wrong: The reply to other numbers.
        blank: The meaning of an empty answer; None: it is returned as None.
    """

    name: str
    words: str
    unit: str
    good: Callable[[float], bool]
    wrong: str
    blank: float | None = None

    def read(self, text: str) -> float | None:
        """The number that a person wrote; None if it is not a possible one."""
        return read_number(text, self.good)


class Person(Protocol):
    """The person beside the robot, at a terminal or a page.

    Attributes:
        enter: What they press to confirm, as the first words of a sentence.
    """

    enter: str

    def about(self, run: str) -> None:
        """The next questions are about this run, such as ``turn left``: for pictures."""

    async def confirm(self, name: str, words: str) -> None:
        """Ask them to do something, and wait until they confirm that it is done."""

    async def start(self, name: str, words: str, bounds: LargestMove) -> None:
        """Announce a movement, and wait until they let it begin."""

    async def number(self, question: Number) -> float | None:
        """Ask until a possible number or an empty answer comes; see :class:`Number`."""

    def say(self, words: str) -> None:
        """Show a sentence."""

    def progress(self, part: int, parts: int, done: float) -> None:
        """Show the progress of a movement: ``done``, from 0 to 1, of this part."""

    def result(self, table: str, facts: dict[str, Any]) -> None:
        """Show the result."""


class Answers:
    """A person at a terminal, or lines of standard input.

    Questions go to standard error, because standard output is the result.
    """

    enter = "Enter"

    def __init__(self, *, as_json: bool = False) -> None:
        self._as_json = as_json
        self._lines = InputLines()
        self._part = 0

    def about(self, run: str) -> None:
        """A terminal shows no pictures."""

    async def confirm(self, name: str, words: str) -> None:
        """Wait for Enter."""
        del name
        await self._line(words)

    async def start(self, name: str, words: str, bounds: LargestMove) -> None:
        """Wait for Enter."""
        self._part = 0
        self.say(f"{words} It will move for at most {bounds.time_s:.0f} s; Ctrl-C stops it.")
        await self.confirm(name, "Enter when its way is free.")

    async def _line(self, question: str) -> str:
        line = await self._lines.ask(question)
        if line is None:
            raise input_ended()
        return line

    async def number(self, question: Number) -> float | None:
        """Ask until a possible number or an empty answer comes."""
        while text := await self._line(question.words):
            if (value := question.read(text)) is not None:
                return value
            print(question.wrong, file=sys.stderr)
        return question.blank

    def say(self, words: str) -> None:
        """Print it."""
        print(words, file=sys.stderr)

    def progress(self, part: int, parts: int, done: float) -> None:
        """Print each part as it begins, in one line."""
        if parts == 1:
            return
        if part != self._part:
            self._part = part
            print(f"\r  part {part} of {parts}", end="", file=sys.stderr, flush=True)
        if part == parts and done >= 1.0:
            print(file=sys.stderr)

    def result(self, table: str, facts: dict[str, Any]) -> None:
        """Print the table, or the facts."""
        print(json.dumps(facts) if self._as_json else table)


def input_ended() -> Refused:
    """The refusal of a calibration whose input has ended."""
    return Refused("The input ended before every question was answered: nothing was written.")


def read_number(text: str, good: Callable[[float], bool]) -> float | None:
    """The number that a person wrote, also with a comma; None if it is not a possible one."""
    value = decimal(text.replace(",", "."))
    return value if not math.isnan(value) and good(value) else None
