"""The output at which a wheel begins to turn, from a slow ramp of the output."""

from __future__ import annotations

from collections.abc import Sequence

MOVED_COUNTS = 3
"""Gears have play, and an encoder may stand on the edge of a count."""

MARGIN_SHARE = 0.025
"""Of full output: so much below the least dead zone of any wheel the board should add, since a
wheel whose dead zone is more than made up for never stands quietly."""


def turning_output(ramp: Sequence[tuple[int, int]]) -> int | None:
    """The output at which the wheel had begun to turn.

    Args:
        ramp: Output and counts since the ramp began, in the order of time.

    Returns:
        The output at the last moment without motion before it went on; None where it never turned.
    """
    if not ramp or abs(ramp[-1][1]) < MOVED_COUNTS:
        return None
    forward = ramp[-1][1] > 0
    still = [output for output, counts in ramp if (counts if forward else -counts) < MOVED_COUNTS]
    return still[-1] if still else ramp[0][0]


def made_up_for(turning: Sequence[int], most_output: int) -> int:
    """The dead zone that a board should add to its output, given those of its wheels."""
    return max(0, round(min(turning) - MARGIN_SHARE * most_output))
