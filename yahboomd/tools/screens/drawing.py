"""A terminal's own screen for rich, and the pieces of both screens."""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from typing import Self

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.control import Control
from rich.panel import Panel
from rich.screen import Screen as Filling
from rich.text import Text

from yahboomd.core.program import plain

QUIET = "bright_black"
"""The style of less important text."""

STATES = {
    "driving": "green",
    "standing": "cyan",
    "stopping": "yellow",
    "waiting": "yellow",
    "estopped": "red",
    "fault": "red",
}
"""The colour of each state of the daemon."""

SEVERITIES = {"info": "blue", "warning": "yellow", "error": "red"}
"""The colour of each severity of an event."""

LONGEST = 1000
"""The most characters of a text to draw: long texts of other programs must not delay the keys."""

Part = tuple[str, str]
"""A text and its style, such as ``bold red``; empty for none."""


def line(*parts: str | Part) -> Text:
    """One line, cut off at the end of the screen. Control characters become blanks."""
    pairs = ((part, "") if isinstance(part, str) else part for part in parts)
    shown = ((plain(words[:LONGEST]), style) for words, style in pairs)
    return Text.assemble(*shown, no_wrap=True, overflow="ellipsis")


def sentence(*parts: str | Part) -> Text:
    """A text over as many lines as it needs."""
    text = line(*parts)
    text.no_wrap, text.overflow = False, "fold"
    return text


def panel(*lines: RenderableType, title: str, note: str = "", style: str = QUIET) -> Panel:
    """A box with a title in its upper and a note in its lower edge."""
    return Panel(
        Group(*lines),
        title=line((title, "bold default")),
        title_align="left",
        subtitle=line((note, QUIET)) if note else None,
        subtitle_align="right",
        border_style=style,
    )


class Widest:
    """The first of these texts that fits the width, or the last one."""

    def __init__(self, *texts: str) -> None:
        self._texts = [Text(each, no_wrap=True, overflow="ellipsis") for each in texts]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        fits = (
            text
            for text in self._texts
            if text.__rich_measure__(console, options).maximum <= options.max_width
        )
        yield next(fits, self._texts[-1])


class Screen:
    """A screen of its own on a terminal, without a cursor; removed on every way out.

    Args:
        gone: Called when the terminal takes no more output.
    """

    def __init__(self, fd: int, gone: Callable[[], None] = lambda: None) -> None:
        self._console = Console(
            file=_Terminal(fd, gone),
            force_terminal=True,
            highlight=False,
            markup=False,
            emoji=False,
        )

    def __enter__(self) -> Self:
        self._console.set_alt_screen(True)
        self._console.show_cursor(False)
        return self

    def __exit__(self, *_: object) -> None:
        self._console.show_cursor(True)
        self._console.set_alt_screen(False)

    def draw(self, *forms: RenderableType) -> None:
        """Draw the first of these forms that fits the terminal's height, or the last one."""
        console = self._console
        fitting = (
            form
            for form in forms[:-1]
            if len(console.render_lines(form, pad=False)) <= console.height
        )
        form = next(fitting, forms[-1])
        console.print(Control.home(), Filling(form), sep="", end="")

    @property
    def size(self) -> tuple[int, int]:
        """Columns and lines."""
        return self._console.size


class _Terminal(io.StringIO):
    """Writes past Python's buffer, so that text for a terminal that hung up fails only once."""

    def __init__(self, fd: int, gone: Callable[[], None]) -> None:
        super().__init__()
        self._gone = gone
        self._fd = fd
        self._written = ""

    def write(self, text: str) -> int:
        if text != self._written:
            self._written, data = text, text.encode("utf-8", "replace")
            try:
                while data:
                    data = data[os.write(self._fd, data) :]
            except OSError:
                self._gone()
        return len(text)
