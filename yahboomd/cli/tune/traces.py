"""A step of all wheels as traces on one grid, from the readings that came meanwhile. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import msgspec

from yahboomd.clock import seconds
from yahboomd.counts import unwrapped
from yahboomd.model import Counts, Motor
from yahboomd.protocol.dialect import Dialect
from yahboomd.tuning import step_response

TICK_S = 0.01
"""Grid of the traces."""

HELD_UP_NS = 70_000_000
"""Longer than between any two readings of a line that nothing holds up."""

Readings = Sequence[tuple[int, Counts]]
"""Counts, with the nanoseconds since the command."""


class Traces(msgspec.Struct, frozen=True, kw_only=True):
    """One step of all wheels.

    Attributes:
        speed_m_s: The commanded speed; negative backward.
        travel_m: Travel of each motor on the grid of :data:`TICK_S`, positive along the command.
        whole: No readings were held up on the way.
    """

    speed_m_s: float
    travel_m: tuple[list[float], ...]
    whole: bool


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
        apart_s: From one renewal of the counts to the next.
        hold_s: How long the speed was commanded.
    """
    way = 1 if speed_m_s > 0.0 else -1
    times_s, counts = _times(dialect, motors, readings, apart_s)
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


def _times(
    dialect: Dialect, motors: Sequence[Motor], readings: Readings, apart_s: float
) -> tuple[list[float], list[Counts]]:
    """When counts were taken, since the command, and those counts."""
    new = [
        (at_ns, ticks)
        for index, (at_ns, ticks) in enumerate(readings)
        if at_ns > 0 and (index == 0 or ticks != readings[index - 1][1])
    ]
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
