from __future__ import annotations

import random

import pytest

from yahboomd.core.odometry.arrivals import BREAK_NS, Arrivals

MS = 1e6


def test_lines_without_delay_left_when_they_came():
    arrivals = Arrivals()
    assert all(abs(arrivals.add(n * 5.9 * MS) - n * 5.9 * MS) < 1.0 for n in range(200))


def test_no_line_left_after_it_came():
    arrivals, chance, came = Arrivals(), random.Random(1), 0.0
    for n in range(500):
        came = max(came, n * 3.0 * MS + chance.uniform(0.0, 16.0) * MS)
        assert arrivals.add(came) <= came


def test_a_timer_of_sixteen_milliseconds_is_seen_through():
    arrivals, errors = Arrivals(), []
    for n in range(1000):
        left = n * 2.46 * MS
        came = (left // (16 * MS) + 1) * 16 * MS
        errors.append(arrivals.add(came) - left)
    settled = errors[200:]
    assert max(settled) < 8 * MS
    assert min(settled) > -3 * MS


def test_lost_lines_do_not_pull_the_clock():
    arrivals, chance = Arrivals(), random.Random(2)
    for n in range(500):
        if chance.random() > 0.1:
            left = arrivals.add(n * 8.3 * MS)
            assert n < 20 or abs(left - n * 8.3 * MS) < 0.5 * MS


def test_a_pause_restarts_it():
    arrivals = Arrivals()
    for n in range(100):
        arrivals.add(n * 5.0 * MS)
    later = 99 * 5.0 * MS + 2 * BREAK_NS
    assert arrivals.add(later) == later


def test_the_spread_tells_jitter_from_a_steady_line():
    steady, held = Arrivals(), Arrivals()
    for n in range(500):
        steady.add(n * 5.0 * MS)
        held.add((n * 5.0 * MS // (16 * MS) + 1) * 16 * MS)
    assert 4.9 * MS < steady.spread < 5.1 * MS
    assert held.spread > 12 * MS


def test_a_backlog_is_not_steady_until_it_has_arrived():
    arrivals = Arrivals()
    for n in range(100):
        arrivals.add(n * 6.0 * MS)
    began = 99 * 6.0 * MS + 2 * BREAK_NS
    for n in range(80):  # 240 ms of lines, twice as fast as they are sent
        arrivals.add(began + n * 3.0 * MS)
        assert not arrivals.steady
    for n in range(80, 100):
        arrivals.add(began + 240 * MS + (n - 80) * 6.0 * MS)
    assert arrivals.steady


def test_lines_that_fill_the_wire_are_steady_only_behind_the_last_read_of_a_backlog():
    arrivals, wire = Arrivals(), 2.0 * MS
    for n in range(100):
        arrivals.add(n * wire, wire)
    came = 99 * wire + 300 * MS
    # Four reads of 44 lines each, 1.5 ms apart: within each the lines look as if they just came.
    for read in range(4):
        for n in range(44):
            arrivals.add(came + read * 1.5 * MS - (43 - n) * wire, wire)
            assert not arrivals.steady
    steady = []
    for n in range(1, 60):
        arrivals.add(came + 4.5 * MS + n * wire, wire)
        steady.append(arrivals.steady)
    assert not steady[0]
    assert steady[-1]


def test_lines_that_leave_the_wire_idle_are_steady_as_soon_as_their_rhythm_shows_it():
    arrivals, wire = Arrivals(), 2.0 * MS
    for n in range(100):
        arrivals.add(n * 6.0 * MS, wire)
    began = 99 * 6.0 * MS + 300 * MS
    steady = [arrivals.add(began + n * 6.0 * MS, wire) and arrivals.steady for n in range(7)]
    assert steady[-1]
    assert not steady[3]


def test_lines_that_stay_faster_for_half_a_second_are_the_new_rate_of_the_board():
    arrivals = Arrivals()
    for n in range(100):
        arrivals.add(n * 6.0 * MS)
    began = 99 * 6.0 * MS + 2 * BREAK_NS
    steady_after = next(
        n * 3.0 * MS
        for n in range(400)
        if arrivals.add(began + n * 3.0 * MS) and n and arrivals.steady
    )
    assert 500 * MS <= steady_after <= 560 * MS
    assert 2.9 * MS < arrivals.gap < 3.1 * MS


def test_the_spread_is_a_gap_and_twice_the_delay_that_all_lines_have():
    arrivals = Arrivals()
    for n in range(500):
        arrivals.add((n * 2.46 * MS // (16 * MS) + 1) * 16 * MS)
    later = 500 * 2.46 * MS + 2 * BREAK_NS
    # After a break that delay is taken off.
    delay = later - arrivals.add(later)
    assert delay > 5 * MS
    assert arrivals.spread == pytest.approx(arrivals.gap + 2.0 * delay)


def steady_after(*came_ms, gap_ms=5.0):
    """The first of these arrivals, after a break, at which lines are steady."""
    arrivals = Arrivals()
    for n in range(100):
        arrivals.add(n * gap_ms * MS)
    began = 99 * gap_ms * MS + 2 * BREAK_NS
    arrivals.add(began)
    for at_ms in came_ms:
        assert arrivals.add(began + at_ms * MS) <= began + at_ms * MS
        if arrivals.steady:
            return at_ms
    return None


def test_lines_are_steady_again_after_25_milliseconds_of_them():
    assert steady_after(*range(5, 60, 5)) == 25


@pytest.mark.parametrize(("first_ms", "steady_ms"), [((), 28), ((0,), 56), ((-10,), 18)])
def test_every_line_of_these_counts_from_the_one_that_came_first(first_ms, steady_ms):
    """Seven in 28 ms are steady, and eight came too fast for the 5 ms at which they are sent."""
    since_ms = min(first_ms, default=0)
    came_ms = range(since_ms + 4, since_ms + 80, 4)
    assert steady_after(*first_ms, *came_ms) == steady_ms


def test_a_backlog_takes_half_a_second_at_most():
    assert steady_after(*(2.5 * n for n in range(1, 400))) == 525.0


def test_before_any_line_came_nothing_is_held_back():
    arrivals = Arrivals()
    assert (arrivals.steady, arrivals.gap, arrivals.spread) == (True, 0.0, 0.0)
