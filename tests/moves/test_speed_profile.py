"""The speed along a course: its limits, its end, its time."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yahboomd.moves.motion.speed_profile import (
    SpeedLimits,
    ideal_time_s,
    next_speed,
    stop_distance,
)

LIMITS = SpeedLimits(speed=0.3, acceleration=0.6, braking=2.4, jerk=4.0)
DT_S = 0.02

some_limits = st.builds(
    SpeedLimits,
    speed=st.floats(0.05, 2.0),
    acceleration=st.floats(0.2, 3.0),
    braking=st.just(12.0),
    jerk=st.floats(1.0, 50.0),
)


def drive(
    way: float, limits: SpeedLimits, *, dt_s: float = DT_S
) -> tuple[float, list[tuple[float, float]]]:
    """The way driven from rest, and speed and rate of each step."""
    driven = speed = rate = 0.0
    steps: list[tuple[float, float]] = []
    for _ in range(100_000):
        speed, rate = next_speed(
            speed, rate, dt_s, left=way - driven, most=limits.speed, limits=limits
        )
        driven += speed * dt_s
        steps.append((speed, rate))
        if way - driven < 1e-4 and speed < 1e-3:
            break
    return driven, steps


@settings(max_examples=20)
@given(some_limits, st.floats(0.01, 5.0))
def test_it_ends_at_the_goal_and_never_beyond_it(limits: SpeedLimits, way: float) -> None:
    driven, _ = drive(way, limits)
    assert way - 1e-4 <= driven <= way + 1e-9


@settings(max_examples=20)
@given(some_limits, st.floats(0.01, 5.0))
def test_speed_and_acceleration_stay_within_the_limits(limits: SpeedLimits, way: float) -> None:
    _, steps = drive(way, limits)
    assert max(speed for speed, _ in steps) <= limits.speed + 1e-9
    assert max(rate for _, rate in steps) <= limits.acceleration + 1e-6


@settings(max_examples=20)
@given(some_limits, st.floats(0.05, 5.0))
def test_the_acceleration_grows_within_the_jerk(limits: SpeedLimits, way: float) -> None:
    _, steps = drive(way, limits)
    rates = [0.0, *(rate for _, rate in steps)]
    grows = max(b - a for a, b in pairwise(rates) if a >= 0.0)
    assert grows <= limits.jerk * DT_S + 1e-6


def test_a_metre_takes_its_ideal_time_and_a_short_landing() -> None:
    _, steps = drive(1.0, LIMITS)
    ideal_s = ideal_time_s(1.0, LIMITS)
    assert ideal_s == pytest.approx(1.0 / 0.3 + 0.3 / 0.6 + 0.6 / 4.0, abs=1e-6)
    assert ideal_s <= len(steps) * DT_S <= ideal_s + 0.9


def test_a_short_way_has_a_shorter_profile() -> None:
    # Twice a stop from v with d = v sqrt(v / j), in 2 sqrt(v / j) each.
    speed = 0.04
    way = 2.0 * speed * math.sqrt(speed / LIMITS.jerk)
    assert ideal_time_s(way, LIMITS) == pytest.approx(4.0 * math.sqrt(speed / 4.0), rel=1e-6)
    assert ideal_time_s(0.0, LIMITS) == 0.0
    assert ideal_time_s(-way, LIMITS) == ideal_time_s(way, LIMITS)


@pytest.mark.parametrize("speed", [0.02, 0.1, 0.3, 1.0])
@pytest.mark.parametrize("share", [-1.0, -0.4, 0.0, 0.7])
def test_the_way_to_rest_is_that_of_a_stop_in_small_steps(speed: float, share: float) -> None:
    rate = share * min(LIMITS.acceleration, math.sqrt(2.0 * LIMITS.jerk * speed))
    expected = stop_distance(speed, rate, LIMITS)
    way, v, a, dt_s = 0.0, speed, rate, 1e-4
    while v > 1e-5 and way < 5.0:
        # Ease off where the jerk is just enough for rate and speed to end together.
        if a < 0.0 and v <= a * a / (2.0 * LIMITS.jerk):
            a = min(-1e-3, a + LIMITS.jerk * dt_s)
        else:
            a = max(-LIMITS.acceleration, a - LIMITS.jerk * dt_s)
        v += a * dt_s
        way += max(0.0, v) * dt_s
    assert way == pytest.approx(expected, rel=0.03, abs=1e-4)


def test_a_way_that_gets_shorter_is_ended_by_braking_harder() -> None:
    speed, rate = 0.3, 0.0
    way = 0.0
    for _ in range(100):
        speed, rate = next_speed(speed, rate, DT_S, left=0.03 - way, most=0.3, limits=LIMITS)
        way += speed * DT_S
        assert rate >= -LIMITS.braking - 1e-9
    assert speed < 1e-3
    assert way < 0.04


def test_a_bend_lowers_the_speed() -> None:
    speed, rate = 0.3, 0.0
    for _ in range(200):
        speed, rate = next_speed(speed, rate, DT_S, left=10.0, most=0.1, limits=LIMITS)
    assert speed == pytest.approx(0.1, abs=1e-3)
