"""Framed lines of styled text, for screens that are drawn ten times a second. Pure.

rich's own panels and tables measure what they hold again and again, nested ones the more: a screen
of them cost four times as much as these lines.
"""

from __future__ import annotations

from collections.abc import Sequence

from rich.cells import cell_len
from rich.text import Text

from yahboomd.cli.screens.ansi import Part
from yahboomd.program import plain

QUIET = "bright_black"
"""The style of what is there to be overlooked."""


def line(*parts: str | Part) -> Text:
    """A line of pieces, each a text or a text in a style. Control characters become blanks."""
    text = Text(no_wrap=True, end="")
    for part in parts:
        words, style = (part, "") if isinstance(part, str) else part
        text.append(plain(words), style or None)
    return text


def fitted(text: Text, width: int) -> Text:
    """A line cut off or filled up to exactly so many columns."""
    fitting = text.copy()
    fitting.truncate(width, overflow="ellipsis", pad=True)
    return fitting


def ends(left: Text, right: Text, width: int) -> Text:
    """A line with something at each end; where they meet, the right one gives way."""
    room = width - left.cell_len
    if right.cell_len + 1 > room:
        return fitted(left + line(" ") + right, width)
    return left + line(" " * (room - right.cell_len)) + right


def framed(
    lines: Sequence[Text],
    *,
    width: int,
    title: str,
    note: str = "",
    style: str = QUIET,
    height: int | None = None,
) -> list[Text]:
    """A box.

    Args:
        lines: What stands in it; what is too wide is cut off.
        width: Columns, frame included.
        title: Stands in the upper edge.
        note: Stands in the lower edge.
        style: Of the frame.
        height: Lines, frame included; as many as needed for None. More are left out.
    """
    inside = width - 4
    shown = list(lines)
    if height is not None:
        shown = (shown + [line()] * height)[: height - 2]
    head, foot = _cut(title, inside - 1), _cut(note, inside - 1)
    top = line(("╭─ ", style), (head, "bold"), (f" {'─' * (inside - 1 - cell_len(head))}╮", style))
    rule = "─" * (inside - 1 - cell_len(foot))
    bottom = line((f"╰{rule} ", style), (foot, QUIET), (" ─╯", style))
    if not foot:
        bottom = line((f"╰{'─' * (width - 2)}╯", style))
    rows = [line(("│ ", style)) + fitted(each, inside) + line((" │", style)) for each in shown]
    return [top, *rows, bottom]


def beside(left: Sequence[Text], right: Sequence[Text]) -> list[Text]:
    """Two boxes of one height, side by side."""
    return [one + other for one, other in zip(left, right, strict=True)]


def stacked(lines: Sequence[Text]) -> Text:
    """All lines as one thing to print."""
    return Text("\n", no_wrap=True, end="").join(lines)


def _cut(words: str, width: int) -> str:
    shown = line(words)
    shown.truncate(max(0, width), overflow="ellipsis")
    return shown.plain
