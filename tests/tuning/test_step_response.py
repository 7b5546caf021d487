"""Counts become travel on a grid, speeds, and the figures of a step."""

from __future__ import annotations

import itertools
import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.tools.tune.estimates.step_response import (
    BAND,
    figures,
    mean,
    on_grid,
    read_times,
    speeds,
    tick_times,
)

TICK_S = 0.01


def second_order(damping: float, rate: float = 20.0, ticks: int = 150) -> list[float]:
    """The step of a second-order lag, whose overshoot is exp(-pi z / sqrt(1 - z^2))."""
    fast = math.sqrt(1.0 - damping**2)
    return [
        1.0
        - math.exp(-damping * rate * t)
        * (math.cos(rate * fast * t) + damping / fast * math.sin(rate * fast * t))
        for t in (tick * TICK_S for tick in range(ticks))
    ]


@pytest.mark.parametrize("damping", [0.2, 0.5, 0.7])
def test_the_overshoot_of_a_second_order_lag_is_the_textbooks(damping):
    expected = math.exp(-math.pi * damping / math.sqrt(1.0 - damping**2))
    assert figures(second_order(damping), 1.0, TICK_S).overshoot == pytest.approx(
        expected, abs=0.01
    )


@pytest.mark.parametrize("lag_s", [0.05, 0.1, 0.2])
def test_a_first_order_lag_rises_in_2_2_and_settles_in_3_time_constants(lag_s):
    trace = [1.0 - math.exp(-tick * TICK_S / lag_s) for tick in range(150)]
    found = figures(trace, 1.0, TICK_S)
    assert found.rise_s == pytest.approx(math.log(9.0) * lag_s, abs=0.003)
    assert found.settling_s == pytest.approx(math.log(20.0) * lag_s, abs=TICK_S)
    assert found.overshoot == 0.0
    assert found.steady_error == pytest.approx(0.0, abs=0.005)


def test_a_speed_that_stays_short_of_the_step_neither_rises_nor_settles():
    found = figures([0.8] * 100, 1.0, TICK_S)
    assert found.rise_s is None
    assert found.settling_s is None
    assert found.steady_error == pytest.approx(-0.2)


def test_one_that_comes_into_the_band_at_the_very_end_has_not_settled():
    assert figures([0.5] * 95 + [1.0] * 5, 1.0, TICK_S).settling_s is None


def test_a_step_backward_has_the_figures_of_one_forward():
    trace = second_order(0.4)
    assert figures([-each for each in trace], -1.0, TICK_S) == figures(trace, 1.0, TICK_S)


@given(st.floats(-2.0, 2.0), st.lists(st.floats(0.001, 0.05), min_size=2, max_size=80))
def test_travel_at_a_constant_speed_is_a_straight_line_whenever_it_was_read(speed, gaps):
    times, at = [], 0.0
    for gap in gaps:
        at += gap
        times.append(at)
    ticks = int(at / TICK_S)
    grid = on_grid(times, [speed * each for each in times], tick_s=TICK_S, ticks=ticks)
    assert grid == pytest.approx([speed * TICK_S * tick for tick in range(ticks + 1)], abs=1e-9)
    if ticks >= 2:
        assert speeds(grid, TICK_S) == pytest.approx([speed] * (ticks + 1), abs=1e-7)


def test_behind_the_last_reading_nothing_moves():
    assert on_grid([0.02], [1.0], tick_s=0.01, ticks=4) == pytest.approx([0.0, 0.5, 1.0, 1.0, 1.0])


@given(
    st.floats(0.0, 0.0099),
    st.lists(st.floats(0.0, 0.0085), min_size=20, max_size=120),
)
def test_late_lines_are_brought_down_to_the_ticks_that_they_are_of(phase, delays):
    arrivals = sorted(phase + tick * TICK_S + late for tick, late in enumerate(delays))
    found = tick_times(arrivals, TICK_S)
    steps = [round((after - before) / TICK_S) for before, after in itertools.pairwise(found)]
    assert all(step >= 1 for step in steps)
    assert all(at <= arrival + 1e-9 for at, arrival in zip(found, arrivals, strict=True))


def test_a_burst_after_a_pause_belongs_to_the_ticks_before_it():
    arrivals = [tick * TICK_S + 0.002 for tick in range(40)]
    # Three lines were held up, and came together with the fourth.
    arrivals[20:23] = [arrivals[23] - 0.0003 * each for each in (3, 2, 1)]
    found = tick_times(arrivals, TICK_S)
    assert [round((at - found[0]) / TICK_S) for at in found] == list(range(40))


@given(st.floats(0.0, 0.0099), st.floats(0.1, 1.0))
def test_reports_by_another_clock_make_a_steady_speed_once_their_ages_are_known(phase, speed):
    sent = [0.041 * number for number in range(1, 37)]
    read = [phase + math.floor((at - phase) / TICK_S) * TICK_S for at in sent]
    found = read_times(sent, [speed * at for at in read], TICK_S)
    slopes = [
        speed * (after - before) / (later - at)
        for (before, after), (at, later) in zip(pairwise(read), pairwise(found), strict=True)
    ]
    assert min(slopes[18:]) == pytest.approx(speed, rel=0.03)
    assert max(slopes[18:]) == pytest.approx(speed, rel=0.03)
    assert all(
        0.0 <= at - earlier <= TICK_S + 1e-9 for at, earlier in zip(sent, found, strict=True)
    )


def test_where_nothing_was_reported_there_are_no_times():
    assert read_times([], [], TICK_S) == []


def test_the_mean_of_repeats_is_taken_tick_by_tick():
    assert mean([[0.0, 1.0, 2.0], [0.0, 3.0, 4.0]]) == [0.0, 2.0, 3.0]


def test_a_rise_is_measured_in_fractions_of_a_tick():
    ramp = [min(1.0, 0.07 * tick) for tick in range(100)]
    assert figures(ramp, 1.0, TICK_S).rise_s == pytest.approx(0.8 / 0.07 * TICK_S)


def test_speeds_are_slopes_over_four_ticks_and_shorter_ones_at_the_ends():
    assert speeds([0.0, 1.0, 4.0, 9.0, 16.0, 25.0], 1.0) == pytest.approx(
        [2.0, 3.0, 4.0, 6.0, 7.0, 8.0]
    )


def test_travel_between_readings_lies_on_straight_lines_and_ends_with_the_last():
    grid = on_grid([0.02, 0.04, 0.05], [1.0, 5.0, 6.0], tick_s=0.01, ticks=7)
    assert grid == pytest.approx([0.0, 0.5, 1.0, 3.0, 5.0, 6.0, 6.0, 6.0])


def test_of_two_readings_of_one_moment_the_later_one_counts():
    grid = on_grid([0.02, 0.02, 0.04], [1.0, 3.0, 5.0], tick_s=0.01, ticks=4)
    assert grid == pytest.approx([0.0, 0.5, 3.0, 4.0, 5.0])


@pytest.mark.parametrize(
    ("outside", "settled"), [(0, 0.0), (1, 0.01), (87, 0.87), (88, None), (90, None)]
)
def test_a_speed_has_settled_that_was_in_the_band_for_half_of_the_end(outside, settled):
    """The end is a quarter: here 25 ticks, of which it has to have been there for more than 12."""
    found = figures([0.5] * outside + [1.0] * (100 - outside), 1.0, TICK_S)
    assert found.settling_s == (None if settled is None else pytest.approx(settled))


def test_what_just_reaches_a_level_has_crossed_it():
    assert figures([0.0, 0.1, 0.5, 0.9, 0.9], 1.0, TICK_S).rise_s == pytest.approx(2 * TICK_S)
    assert figures([1.0, 1.0, 1.0], 1.0, TICK_S).rise_s == 0.0
    assert figures([0.05, 0.55, 1.05], 1.0, TICK_S).rise_s == pytest.approx(1.6 * TICK_S)


def test_the_end_of_a_short_step_is_its_last_tick():
    assert figures([0.0, 0.5, 0.8], 1.0, TICK_S).steady_error == pytest.approx(-0.2)
    assert BAND == 0.05


@pytest.mark.parametrize("phase", [0.0, 0.003, 0.0071])
def test_ticks_are_found_to_a_tenth_of_one_where_lines_are_hardly_late(phase):
    arrivals = [phase + tick * TICK_S + 0.0004 * (tick % 3) for tick in range(60)]
    found = tick_times(arrivals, TICK_S)
    assert all(0.0 <= at - tick <= TICK_S for at, tick in zip(arrivals, found, strict=True))
    assert [round((at - found[0]) / TICK_S) for at in found] == list(range(60))


@pytest.mark.parametrize("late", [1, 2])
def test_lines_that_came_in_one_tick_are_of_those_before_it_from_the_first_on(late):
    arrivals = [tick * TICK_S + 0.004 for tick in range(40)]
    arrivals[0] = arrivals[late] - 0.0002 * late
    for tick in range(1, late):
        arrivals[tick] = arrivals[late] - 0.0002 * (late - tick)
    found = tick_times(arrivals, TICK_S)
    assert [round((at - found[-1]) / TICK_S) for at in found] == list(range(-39, 1))


def test_a_last_line_that_came_with_the_one_before_it_is_of_the_tick_after():
    arrivals = [tick * TICK_S + 0.004 for tick in range(40)]
    arrivals[38] = arrivals[39] - 0.0002
    found = tick_times(arrivals, TICK_S)
    assert [round((at - found[0]) / TICK_S) for at in found] == list(range(40))
