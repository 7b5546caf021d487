"""A wheel's answer to a step of its speed: travel on a common grid, and the figures of the step.

Speeds are slopes of the travel over :data:`WINDOW` ticks. The travel of repeated steps is averaged
first: each begins at another place between two counts, so the mean is finer than a count.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import msgspec
import numpy as np

BAND = 0.05
"""Share of the step within which the speed counts as settled."""

WINDOW = 4
"""Ticks of a slope; with ticks of 10 ms one count more or less in it is 1 % of 0.4 m/s."""

END_SHARE = 0.25
"""The last part of a step, whose mean gives the steady error."""


class StepFigures(msgspec.Struct, frozen=True, kw_only=True):
    """The figures of a step.

    Attributes:
        rise_s: The time from a tenth to nine tenths of the step; None if it does not reach them.
        overshoot: The excess over the step, as a share of it.
        settling_s: The time from the command until the speed stays within 5 % of the step; None if
            it does not.
        steady_error: The mean of the end minus the step, as a share of it.
    """

    rise_s: float | None
    overshoot: float
    settling_s: float | None
    steady_error: float


def tick_times(arrivals_s: Sequence[float], tick_s: float) -> list[float]:
    """The ticks at which a board renewed counts that came at these times.

    A line cannot come before its tick, and each tick's counts are new: so arrivals are rounded down
    to a grid, each at least a tick before the next. The grid is the one on which most arrivals are
    one tick apart.

    Args:
        arrivals_s: The times at which changed counts came; rising.
        tick_s: The period at which the board renews them.
    """
    phases = [tick_s * part / 20.0 for part in range(20)]

    def ticks(phase: float) -> list[int]:
        return [math.floor((at - phase) / tick_s) for at in arrivals_s]

    def regular(phase: float) -> int:
        return sum(after - before == 1 for before, after in pairwise(ticks(phase)))

    best = max(map(regular, phases))
    good = [phase for phase in phases if regular(phase) >= 0.95 * best]
    phase = good[len(good) // 2]
    found = ticks(phase)
    for index in range(len(found) - 2, -1, -1):
        found[index] = min(found[index], found[index + 1] - 1)
    return [phase + tick * tick_s for tick in found]


def read_times(arrivals_s: Sequence[float], travel: Sequence[float], tick_s: float) -> list[float]:
    """The ticks at which a board read the counts of its reports, which are rarer, by another clock.

    Reported counts are up to a tick old, and their age drifts: at a steady speed some slopes are
    off by a quarter. The grid of ticks is the one on which the second half of the step is nearest
    to a straight line.

    Args:
        arrivals_s: The times at which reports left; rising.
        tick_s: The period at which the board reads.
    """
    if not arrivals_s:
        return []
    half = len(arrivals_s) // 2
    places = _centred(travel[half:])

    def ticks(phase: float) -> list[float]:
        return [phase + math.floor((at - phase) / tick_s) * tick_s for at in arrivals_s]

    def roughness(phase: float) -> float:
        times = _centred(ticks(phase)[half:])
        spread = sum(at * at for at in times)
        slope = sum(at * x for at, x in zip(times, places, strict=True)) / (spread or 1.0)
        return sum((x - slope * at) ** 2 for at, x in zip(times, places, strict=True))

    return ticks(min((tick_s * part / 40.0 for part in range(40)), key=roughness))


def _centred(values: Sequence[float]) -> list[float]:
    mean = sum(values) / len(values)
    return [value - mean for value in values]


def on_grid(
    times_s: Sequence[float], travel: Sequence[float], *, tick_s: float, ticks: int
) -> list[float]:
    """Travel at 0, 1, 2 ... ticks, interpolated between the readings.

    Args:
        times_s: The times of the readings, since the command; rising.
        travel: The travel at those times, since the command.
    """
    at = np.arange(ticks + 1) * tick_s
    grid: list[float] = np.interp(at, [0.0, *times_s], [0.0, *travel]).tolist()
    return grid


def mean(traces: Sequence[Sequence[float]]) -> list[float]:
    """The mean of repeated steps."""
    return [sum(values) / len(traces) for values in zip(*traces, strict=True)]


def speeds(travel: Sequence[float], tick_s: float) -> list[float]:
    """Slopes of the travel over :data:`WINDOW` ticks, centred; shorter ones at both ends."""
    last, half = len(travel) - 1, WINDOW // 2
    found = []
    for tick in range(len(travel)):
        low, high = max(0, tick - half), min(last, tick + half)
        found.append((travel[high] - travel[low]) / ((high - low) * tick_s))
    return found


def figures(trace: Sequence[float], target: float, tick_s: float) -> StepFigures:
    """The figures of a step from rest.

    Args:
        trace: Speeds by tick since the command.
        target: The commanded speed, in the same unit, not 0.
    """
    shares = [value / target for value in trace]
    tenth = _crossing(shares, 0.1)
    nine_tenths = _crossing(shares, 0.9)
    outside = [tick for tick, share in enumerate(shares) if abs(share - 1.0) > BAND]
    settled = outside[-1] + 1 if outside else 0
    end = shares[-max(1, round(END_SHARE * len(shares))) :]
    return StepFigures(
        rise_s=None if tenth is None or nine_tenths is None else (nine_tenths - tenth) * tick_s,
        overshoot=max(0.0, max(shares) - 1.0),
        # A speed that enters the band at the very end has not been seen to stay.
        settling_s=settled * tick_s if settled < len(shares) - len(end) // 2 else None,
        steady_error=sum(end) / len(end) - 1.0,
    )


def _crossing(shares: Sequence[float], level: float) -> float | None:
    """The tick at which a level is first crossed, with its fraction."""
    before = 0.0
    for tick, share in enumerate(shares):
        if share >= level:
            rise = share - before
            return tick - (share - level) / rise if tick and rise > 0.0 else float(tick)
        before = share
    return None
