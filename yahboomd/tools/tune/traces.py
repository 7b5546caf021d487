"""A step of all wheels as traces on one grid, from its readings. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from statistics import median

import msgspec

from yahboomd.core.clock import seconds
from yahboomd.core.counts import unwrapped
from yahboomd.core.model import Counts, Motor
from yahboomd.core.protocol.dialect import Dialect
from yahboomd.tools.tune.estimates import step_response

TICK_S = 0.01
"""Grid of the traces."""

HELD_UP_NS = 70_000_000
"""Longer than the time between any two readings of an undisturbed line."""

Readings = Sequence[tuple[int, Counts]]
"""Counts, with the nanoseconds since the command."""


class Traces(msgspec.Struct, frozen=True, kw_only=True):
    """One step of all wheels.

    Attributes:
        speed_m_s: The commanded speed; negative backward.
        travel_m: Travel of each motor on the grid of :data:`TICK_S`, positive along the command.
        whole: No readings were delayed during the step.
    """

    speed_m_s: float
    travel_m: tuple[list[float], ...]
    whole: bool


GARBLED_M = 0.003
GARBLED_SHARE = 0.3
"""Share of the commanded travel between two readings. A reading farther than this, and than 3 mm,
from the line between its neighbours has an altered digit: no motor moves a wheel like that."""


ODD_SHARE = 0.05
"""Repeated steps end nearer to each other than this share of their travel."""

ODD_M = 0.01
"""The least travel to take the share of: a wheel with soft gains may stand."""


def traces_of(
    dialect: Dialect,
    motors: Sequence[Motor],
    readings: Readings,
    first: Counts,
    *,
    apart_s: float,
    speed_m_s: float,
    hold_s: float,
) -> Traces:
    """The traces of a step.

    Args:
        first: The counts from which every wheel began.
        apart_s: The time from one renewal of the counts to the next.
        hold_s: How long the speed was commanded.
    """
    way = 1 if speed_m_s > 0.0 else -1
    new = _without_garbled(motors, _new(readings), speed_m_s)
    times_s, counts = _times(dialect, motors, new, apart_s)
    times_ns = [0, *(at_ns for at_ns, _ in readings if at_ns > 0)]
    return Traces(
        speed_m_s=speed_m_s,
        whole=max(after - before for before, after in pairwise(times_ns)) < HELD_UP_NS,
        travel_m=tuple(
            step_response.on_grid(
                times_s,
                [
                    unwrapped(each[motor.position - 1] - first[motor.position - 1])
                    * (motor.encoder_sign * way * motor.metres_per_tick)
                    for each in counts
                ],
                tick_s=TICK_S,
                ticks=round(hold_s / TICK_S),
            )
            for motor in motors
        ),
    )


def odd_one(steps: Sequence[Traces]) -> Traces | None:
    """The step that ends at another place than the others: the line lost or altered its command."""
    motors = zip(*(step.travel_m for step in steps), strict=True)
    usual_m: list[float] = [median(travel[-1] for travel in each) for each in motors]

    def off(step: Traces) -> float:
        return max(
            abs(travel[-1] - usual) / max(usual, ODD_M)
            for travel, usual in zip(step.travel_m, usual_m, strict=True)
        )

    odd = max(steps, key=off)
    return odd if off(odd) > ODD_SHARE else None


def _new(readings: Readings) -> Readings:
    """The readings since the command that differ from the one before."""
    return [
        (at_ns, ticks)
        for index, (at_ns, ticks) in enumerate(readings)
        if at_ns > 0 and (index == 0 or ticks != readings[index - 1][1])
    ]


def _times(
    dialect: Dialect, motors: Sequence[Motor], new: Readings, apart_s: float
) -> tuple[list[float], list[Counts]]:
    """The times of the readings since the command, and their counts."""
    times_s = [seconds(at_ns) for at_ns, _ in new]
    if dialect.sample_period_ns is not None and not dialect.renews_with_each_line:
        times_s = step_response.tick_times(times_s, apart_s)
    elif dialect.age_ns:
        driven = [
            sum(
                unwrapped(each[motor.position - 1] - new[0][1][motor.position - 1])
                * motor.encoder_sign
                for motor in motors
            )
            for _, each in new
        ]
        times_s = step_response.read_times(times_s, driven, seconds(dialect.age_ns))
    kept = [(at_s, ticks) for at_s, (_, ticks) in zip(times_s, new, strict=True) if at_s > 0.0]
    return [at_s for at_s, _ in kept], [ticks for _, ticks in kept]


def _without_garbled(motors: Sequence[Motor], readings: Readings, speed_m_s: float) -> Readings:
    """The readings without those with an altered digit, which no checksum shows.

    The readings next to an altered one are off the line between their neighbours, too, but only
    half as far.
    """
    inner = zip(readings[:-2], readings[1:-1], readings[2:], strict=True)
    off_m = [0.0, *(_off_m(motors, *three, speed_m_s) for three in inner), 0.0]
    return [
        reading
        for index, reading in enumerate(readings)
        if not off_m[index] or off_m[index] < max(off_m[index - 1 : index + 2])
    ]


def _off_m(
    motors: Sequence[Motor],
    before: tuple[int, Counts],
    reading: tuple[int, Counts],
    after: tuple[int, Counts],
    speed_m_s: float,
) -> float:
    """The largest distance of a wheel from the line between neighbours; 0 if motors can do that."""
    (start_ns, first), (at_ns, counts), (end_ns, last) = before, reading, after
    if not 0 < end_ns - start_ns < HELD_UP_NS:
        return 0.0
    share = (at_ns - start_ns) / (end_ns - start_ns)
    farthest_m = max(
        abs(unwrapped(counts[place] - first[place]) - share * unwrapped(last[place] - first[place]))
        * metres_per_tick
        for place, metres_per_tick in ((it.position - 1, it.metres_per_tick) for it in motors)
    )
    commanded_m = abs(speed_m_s) * seconds(end_ns - start_ns) / 2.0
    return farthest_m if farthest_m > max(GARBLED_M, GARBLED_SHARE * commanded_m) else 0.0
