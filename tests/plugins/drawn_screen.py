"""A screen as rich draws it for a terminal of some size: its lines, and the style of a word."""

from __future__ import annotations

import io

from rich.console import Console, RenderableType
from rich.screen import Screen
from rich.segment import Segment


def segments(drawn: RenderableType, width: int, height: int) -> list[list[Segment]]:
    """The lines of a screen, in pieces of one style."""
    console = Console(
        file=io.StringIO(), width=width, height=height, highlight=False, markup=False, emoji=False
    )
    return console.render_lines(Screen(drawn), console.options, pad=False)


def lines(drawn: RenderableType, width: int = 80, height: int = 24) -> list[str]:
    """The lines of a screen."""
    return ["".join(each.text for each in line) for line in segments(drawn, width, height)]


def style_of(words: str, drawn: RenderableType) -> str:
    """The style of the piece that has these words."""
    pieces = (each for line in segments(drawn, 80, 24) for each in line if words in each.text)
    return str(next(pieces).style)
