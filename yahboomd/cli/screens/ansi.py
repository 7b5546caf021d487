"""Colours and full screens by escape sequences, where a dependency would be too much. Pure."""

from __future__ import annotations

from collections.abc import Sequence

from yahboomd.program import plain

ENTER = "\x1b[?1049h\x1b[?25l"
"""A screen of its own, without a cursor."""

LEAVE = "\x1b[?25h\x1b[?1049l"
"""Back to what was there before."""

_CODES = {
    "bold": "1",
    "dim": "2",
    "reverse": "7",
    "red": "31",
    "green": "32",
    "yellow": "33",
    "blue": "34",
    "cyan": "36",
    "default": "39",
}

Part = tuple[str, str]
"""A text and its style, such as ``bold red``; empty for none."""


def paint(parts: Sequence[Part], width: int, *, colours: bool = True) -> str:
    """Parts as a line of at most ``width`` characters; what is too much is cut off.

    Args:
        parts: The texts in their styles.
        width: The room.
        colours: Whether styles are written at all.
    """
    painted, room = "", width
    for text, style in parts:
        shown = plain(text)
        if len(shown) > room:
            shown = shown[: max(0, room - 1)] + "…"[:room]
        room -= len(shown)
        codes = ";".join(_CODES[each] for each in style.split())
        painted += f"\x1b[{codes}m{shown}\x1b[0m" if codes and colours and shown else shown
    return painted


def frame(lines: Sequence[str], height: int) -> str:
    """A whole screen, drawn over the one before without flicker."""
    # Cleared first: behind a line as long as the screen is wide, its last character would go.
    return "\x1b[H" + "\r\n".join(f"\x1b[2K{line}" for line in lines[:height]) + "\x1b[0J"
