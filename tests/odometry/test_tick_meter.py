from __future__ import annotations

import random

import pytest

from yahboomd.core.odometry.tick_meter import Measured, TickMeter, TickPeriod

MS = 1e6


def measured(tick_ms, *, gap_ms=2.46, jitter_ms=0.0, speed=3000.0, seconds=3.0, loss=0.0):
    """The meter's result for a wheel with ``speed`` counts a second."""
    chance, meter, found = random.Random(1), TickMeter(), []
    next_ms, sampled_ms, at_ms, before = 0.0, 0.0, 0.3, 0
    while at_ms < seconds * 1e3:
        if tick_ms:
            while next_ms <= at_ms:
                sampled_ms = next_ms
                next_ms += tick_ms + chance.uniform(0.0, jitter_ms)
        else:
            sampled_ms = at_ms
        counts = int(sampled_ms * speed * 1e-3)
        if chance.random() >= loss:
            one = meter.add(at_ms * MS, counts - before, gap_ms * MS, gap_ms * MS)
            before = counts
            if one is not None:
                found.append(one)
        at_ms += gap_ms
    return found


@pytest.mark.parametrize("gap_ms", [2.46, 5.917])
@pytest.mark.parametrize("tick_ms", [5.0, 8.0, 10.0, 20.0, 40.0])
def test_a_timer_of_whole_milliseconds_is_measured(tick_ms, gap_ms):
    if tick_ms < gap_ms:
        return
    found = measured(tick_ms, gap_ms=gap_ms, seconds=5.0)
    assert len(found) >= 2
    assert all(one.regular and round(one.period / MS) == tick_ms for one in found)


@pytest.mark.parametrize("gap_ms", [2.46, 5.917])
def test_without_a_tick_nothing_is_marked(gap_ms):
    found = measured(0.0, gap_ms=gap_ms)
    assert len(found) >= 4
    assert not any(one.marked for one in found)


def test_an_irregular_tick_is_not_regular():
    found = measured(8.0, jitter_ms=6.0, seconds=10.0)
    assert sum(one.regular for one in found) <= len(found) // 4


def test_lines_that_were_lost_are_counted_by_their_counts():
    found = measured(10.0, gap_ms=5.917, loss=0.2, seconds=10.0)
    assert all(abs(one.period - 10 * MS) < 0.2 * MS for one in found)


def test_a_crawl_tells_nothing():
    assert measured(10.0, speed=150.0) == []


def of(tick_ms: float, *, regular: bool = True) -> Measured:
    return Measured(tick_ms * MS, regular, marked=True)


def test_another_period_needs_two_measurements_in_a_row():
    renewal = TickPeriod(10.0 * MS)
    for _ in range(3):
        assert not renewal.weigh(of(5.0))
        assert not renewal.weigh(of(10.1))
    assert not renewal.weigh(of(5.0))
    assert renewal.weigh(of(5.0))
    assert (renewal.period, renewal.notice) == (5.0 * MS, "period")


def test_misfits_before_a_measurement_that_fits_do_not_count():
    renewal = TickPeriod(10.0 * MS)
    for _ in range(3):
        renewal.misfit()
        renewal.misfit()
        assert not renewal.weigh(of(10.0))
    assert renewal.fits
    renewal.misfit()
    renewal.misfit()
    assert renewal.weigh(of(7.3, regular=False))
    assert (renewal.fits, renewal.notice) == (False, "unfit")


def changes(*takes, tick_ms=8.0, first=20, counts_per_tick=(20,), spread_ms=1.0):
    """The first result of lines that each bring a change of 20 counts in a tick."""
    meter, at_ms = TickMeter(), 0.0
    for number in range(600):
        took = takes[number % len(takes)]
        at_ms += took
        a_tick = counts_per_tick[number % len(counts_per_tick)]
        counts = a_tick * max(1, round(took / tick_ms)) if number else first
        found = meter.add(at_ms * MS, counts, MS, spread_ms * MS)
        if found is not None:
            return found
    return None


@pytest.mark.parametrize(("off_ms", "regular"), [(0.0, True), (1.3, True), (1.7, False)])
def test_changes_that_scatter_by_more_than_their_lines_are_of_no_timer(off_ms, regular):
    found = changes(8.0 - off_ms, 8.0 + off_ms)
    assert found.period == pytest.approx(8.0 * MS, rel=0.003)
    assert found.regular is regular


@pytest.mark.parametrize(
    ("tick_ms", "regular"), [(1.0, False), (2.0, True), (8.04, True), (8.1, False), (8.5, False)]
)
def test_a_timer_counts_whole_milliseconds_two_at_least(tick_ms, regular):
    assert changes(tick_ms, tick_ms=tick_ms).regular is regular


@pytest.mark.parametrize(("every", "marked"), [(25, True), (40, True), (49, False)])
def test_a_fortieth_of_the_lines_has_to_mark_a_tick(every, marked):
    # Just forty changes fill the time of a measurement.
    tick_ms = 9.9 if every == 40 else 8.0
    found = changes(*[tick_ms] * (every - 1), 2.0 * tick_ms, tick_ms=tick_ms)
    assert found.marked is marked


def test_a_pace_that_was_taken_for_half_of_what_it_is_is_found_out():
    assert changes(8.0, first=10).period == pytest.approx(8.0 * MS)


def test_a_wheel_that_stands_in_between_shows_no_period():
    meter, at_ms = TickMeter(), 0.0
    for _ in range(20):
        for took in [8.0] * 20 + [150.0]:
            at_ms += took
            assert meter.add(at_ms * MS, 20, MS, MS) is None


@pytest.mark.parametrize("first_ms", [10.0, 5.0])
def test_measurements_that_fit_or_agree_forgive_the_misfits_before_them(first_ms):
    renewal = TickPeriod(10.0 * MS)
    renewal.misfit()
    renewal.weigh(of(first_ms))
    renewal.weigh(of(first_ms))
    assert renewal.period == first_ms * MS
    renewal.misfit()
    assert not renewal.weigh(of(7.3, regular=False))
    assert renewal.fits


def test_changes_are_as_far_apart_as_the_lines_between_them():
    meter = TickMeter()
    for n in range(40):
        meter.add(2.5 * n * MS, 0 if n % 4 else 20, 2.5 * MS, 2.5 * MS)
    assert meter.spacing == 10.0 * MS


@pytest.mark.parametrize(("tick_ms", "ticks"), [(8.0, 50), (20.0, 24)])
def test_a_measurement_takes_24_ticks_and_400_milliseconds_after_eight_changes(tick_ms, ticks):
    meter = TickMeter()
    found = [n for n in range(200) if meter.add(n * tick_ms * MS, 20, MS, MS) is not None]
    assert found[:3] == [8 + ticks, 8 + 2 * ticks, 8 + 3 * ticks]


@pytest.mark.parametrize(("tick_ms", "marked"), [(10.3, True), (8.0, False)])
def test_a_line_that_repeats_the_totals_marks_a_tick_among_forty(tick_ms, marked):
    meter, found = TickMeter(), None
    for n in range(100):
        found = found or meter.add(n * tick_ms * MS, 20, MS, MS)
        if n == 20:
            meter.add((n + 0.5) * tick_ms * MS, 0, MS, MS)
    assert found.marked is marked


def test_three_counts_a_tick_are_fast():
    assert changes(8.0, first=3, counts_per_tick=(3,)).period == pytest.approx(8.0 * MS)
    assert changes(8.0, first=2, counts_per_tick=(2,)) is None


@pytest.mark.parametrize(("ticks", "known"), [(4, True), (5, False)])
def test_up_to_four_ticks_are_distinguished_from_a_change_of_speed(ticks, known):
    found = changes(*[8.0] * 20, ticks * 8.0)
    assert (found is not None) is known


def test_a_speed_that_changes_by_a_third_from_tick_to_tick_is_no_other_tick():
    found = changes(8.0, counts_per_tick=(20, 28))
    assert (found.period, found.regular) == (pytest.approx(8.0 * MS), True)


@pytest.mark.parametrize(
    ("tick_ms", "scatter_ms", "regular"),
    [(8.15, 0.5, False), (8.1, 6.0, False), (8.05, 6.0, True), (40.22, 0.0, False)],
)
def test_how_far_from_a_whole_millisecond_a_period_may_be(tick_ms, scatter_ms, regular):
    """As far as its scatter explains, and a fifth of a millisecond at most."""
    takes = (tick_ms - scatter_ms, tick_ms + scatter_ms)
    assert changes(*takes, tick_ms=tick_ms, spread_ms=10.0).regular is regular


def test_a_doubt_is_the_share_by_which_a_measurement_is_off_by_more_than_three_percent():
    renewal = TickPeriod(10.0 * MS)
    assert renewal.doubt == 0.0
    for tick_ms, doubt in ((5.0, 0.5), (10.3, 0.0), (10.4, 0.04), (9.7, 0.0), (12.0, 0.2)):
        renewal.weigh(of(tick_ms, regular=False))
        assert renewal.doubt == pytest.approx(doubt)
    renewal.weigh(of(5.0))
    assert renewal.weigh(of(5.0))
    assert renewal.doubt == 0.0


def test_three_misfits_in_a_row_are_no_tick_and_four_measurements_are_one_again():
    renewal = TickPeriod(10.0 * MS)
    assert [renewal.weigh(of(7.3, regular=False)) for _ in range(3)] == [False, False, True]
    assert (renewal.fits, renewal.notice) == (False, "unfit")
    assert [renewal.weigh(of(10.0)) for _ in range(4)] == [False, False, False, True]
    assert (renewal.fits, renewal.notice, renewal.period) == (True, "period", 10.0 * MS)


def test_measurements_with_a_misfit_between_them_are_not_in_a_row():
    renewal = TickPeriod(10.0 * MS)
    renewal.weigh(of(5.0))
    renewal.weigh(of(7.3, regular=False))
    assert not renewal.weigh(of(5.0))
    assert renewal.weigh(of(5.0))
