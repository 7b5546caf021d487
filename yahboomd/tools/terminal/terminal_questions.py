"""Asks the person at the terminal, or reads lines of standard input."""

from __future__ import annotations

import os
import sys
import textwrap
from collections.abc import Iterable
from typing import Protocol

from yahboomd.tools.terminal.asking import input_ended
from yahboomd.tools.terminal.input_lines import InputLines

WIDTH = 100


class Respondent(Protocol):
    """The person who answers."""

    async def line(self, question: str) -> str:
        """Ask, and wait for a line."""


class Terminal:
    """Asks on standard error, because standard output is for the result."""

    def __init__(self) -> None:
        self._lines = InputLines()

    async def line(self, question: str) -> str:
        """Ask, and wait for a line."""
        line = await self._lines.ask(question, fresh=True)
        if line is None:
            raise input_ended()
        return line


def say(words: str = "") -> None:
    """Print words for the person."""
    print(words, file=sys.stderr, flush=True)


def say_heading(words: str) -> None:
    """Print a heading, in bold on a terminal."""
    bold = sys.stderr.isatty() and not os.environ.get("NO_COLOR")
    say(f"\n\x1b[1m{words}\x1b[0m" if bold else f"\n{words}")


def say_points(points: Iterable[str]) -> None:
    """Print sentences as a list."""
    for words in points:
        say(textwrap.fill(words, WIDTH, initial_indent="  - ", subsequent_indent="    "))


async def agrees(
    person: Respondent, question: str, *, hint: str = " [y/N]", blank: bool | None = False
) -> bool:
    """Ask until the answer is yes or no.

    Args:
        blank: The meaning of an empty answer; None: ask again.
    """
    while True:
        answer = yes_or_no(await person.line(f"{question}{hint}"), blank=blank)
        if answer is not None:
            return answer
        say("y or n, please.")


def yes_or_no(answer: str, *, blank: bool | None = False) -> bool | None:
    """The meaning of an answer; None if it is neither yes nor no."""
    if not answer:
        return blank
    return {"y": True, "yes": True, "n": False, "no": False}.get(answer.lower())
