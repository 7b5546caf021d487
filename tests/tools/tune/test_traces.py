"""Readings of a step as traces: along the command, on one grid, and held up or not."""

from __future__ import annotations

import pytest

from yahboomd.core.model import Counts, Motor
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.tools.tune.traces import TICK_S, Traces, odd_one, traces_of

NEW_NS = 20_000_000
FIRST: Counts = (1000, 0, 2**31 - 50, 0)
MOTORS = (
    Motor(name="left", wheel=0, position=1, radius_m=0.05, ticks_per_revolution=1000.0),
    Motor(
        name="right", wheel=1, position=3, encoder_sign=-1, radius_m=0.05, ticks_per_revolution=1000
    ),
)


def readings(number: int, per_reading: int) -> list[tuple[int, Counts]]:
    """Both wheels roll on by the same distance each time; a counter passes its end."""
    found = []
    for index in range(number):
        travelled = index * per_reading
        right = (FIRST[2] - travelled + 2**31) % 2**32 - 2**31
        found.append((index * NEW_NS, (FIRST[0] + travelled, 0, right, 0)))
    return found


def found_in(rows: list[tuple[int, Counts]], speed_m_s: float = 0.3):
    return traces_of(
        DIALECTS["polled"],
        MOTORS,
        rows,
        FIRST,
        apart_s=NEW_NS / 1e9,
        speed_m_s=speed_m_s,
        hold_s=0.2,
    )


@pytest.mark.parametrize("way", [1, -1])
def test_travel_is_positive_along_the_command_for_every_motor(way: int) -> None:
    traces = found_in(readings(14, 20 * way), 0.3 * way)
    a_second = 20 * MOTORS[0].metres_per_tick / (NEW_NS / 1e9)
    for travel in traces.travel_m:
        assert travel == pytest.approx([a_second * TICK_S * tick for tick in range(21)], abs=1e-9)
    assert traces.whole


def test_a_trace_says_that_readings_were_held_up() -> None:
    rows = readings(14, 20)
    assert not found_in([*rows[:3], *rows[7:]]).whole


def test_the_step_that_ends_elsewhere_than_the_others_is_odd_also_where_a_wheel_stands() -> None:
    def step(left_m: float, right_m: float) -> Traces:
        return Traces(speed_m_s=0.4, travel_m=([0.0, left_m], [0.0, right_m]), whole=True)

    usual = [step(0.5, 0.0), step(0.51, 0.0), step(0.49, 0.0)]
    assert odd_one([*usual, step(0.5, 0.0004)]) is None
    for odd in (step(0.45, 0.0), step(0.55, 0.0), step(0.5, 0.1)):
        assert odd_one([*usual, odd]) is odd
