"""The output at which a wheel begins to turn, from a slow ramp of the output."""

from __future__ import annotations

from collections.abc import Sequence

MOVED_COUNTS = 3
"""Fewer may be the play of the gears, or an encoder on the edge of a count."""

MARGIN_SHARE = 0.025
"""Share of full output by which the board's dead zone should be below the smallest one of a wheel:
a wheel with an overcompensated dead zone never stands quietly."""


def turning_output(ramp: Sequence[tuple[int, int]]) -> int | None:
    """The output at which the wheel had begun to turn.

    Args:
        ramp: Output and counts since the ramp began, in the order of time.

    Returns:
        The last output at which it still stood; None if it never turned.
    """
    if not ramp or abs(ramp[-1][1]) < MOVED_COUNTS:
        return None
    forward = ramp[-1][1] > 0
    still = [output for output, counts in ramp if (counts if forward else -counts) < MOVED_COUNTS]
    return still[-1] if still else ramp[0][0]


def made_up_for(turning: Sequence[int], most_output: int) -> int:
    """The dead zone that a board should add to its output, from those of its wheels."""
    return max(0, round(min(turning) - MARGIN_SHARE * most_output))
