"""The outputs at which a wheel begins to turn and stops, from a slow ramp of the output.

A wheel at rest needs more than one that turns. A board adds its stored dead zone to each output, so
one above what a turning wheel needs never lets it stand quietly: the wheel that stops is measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

MOVED_COUNTS = 3
"""Fewer may be the play of the gears, or an encoder on the edge of a count."""

MARGIN_SHARE = 0.025
"""Share of full output by which the board's dead zone should be below the smallest one of a wheel:
a wheel with an overcompensated dead zone never stands quietly."""

HELD_S = 0.3
"""The end of a held output, whose speed is that of the output."""


class RampSample(NamedTuple):
    """An output, and the counts by then since the ramp began, positive along the output."""

    at_s: float
    output: int
    counts: int


Ramp: TypeAlias = list[RampSample]
"""In the order of time."""


def turning_output(rise: Sequence[RampSample]) -> int | None:
    """The output at which the wheel had begun to turn.

    Returns:
        The last output at which it still stood; None if it never turned.
    """
    if not rise or rise[-1].counts < MOVED_COUNTS:
        return None
    still = [each.output for each in rise if each.counts < MOVED_COUNTS]
    return still[-1] if still else rise[0].output


def stopping_output(fall: Sequence[RampSample]) -> int:
    """The output at which the wheel stopped.

    Where it turned even with the least output, the speeds of the two that were held give it: a
    wheel turns by what an output exceeds its friction.
    """
    last = fall[-1]
    held = [each for each in fall if each.output == last.output and each.at_s > last.at_s - HELD_S]
    least = min(each.output for each in fall)
    if last.output > least:
        fast = _speed(held)
        end = max(each.at_s for each in fall if each.output == least)
        slow = _speed([each for each in fall if end - HELD_S < each.at_s <= end])
        if fast > slow:
            return max(0, round(least - slow * (last.output - least) / (fast - slow)))
        return least
    turning = [each.output for each in fall if last.counts - each.counts >= MOVED_COUNTS]
    return turning[-1] if turning else fall[0].output


def made_up_for(stopping: Sequence[int], most_output: int) -> int:
    """The dead zone that a board should add to its output, from those of its wheels."""
    return max(0, round(min(stopping) - MARGIN_SHARE * most_output))


def _speed(held: Sequence[RampSample]) -> float:
    """Counts in a second from the first to the last."""
    first, last = held[0], held[-1]
    return (last.counts - first.counts) / max(1e-3, last.at_s - first.at_s)
