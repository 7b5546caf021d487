from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from yahboomd.core.counts import CountHistory, slowest, unwrapped

MS = 1_000_000
S = 1000 * MS


def seen(readings: list[tuple[int, ...]], keep_ms: int = 200) -> CountHistory:
    """Readings of one motor, each a time in milliseconds and a total."""
    history = CountHistory(keep_ms * MS, 3)
    for at_ms, total in readings:
        history.add(at_ms * MS, (total,))
    return history


def steady(per_reading: int, period_ms: int, count: int = 12) -> list[tuple[int, int]]:
    return [(1000 + n * period_ms, n * per_reading) for n in range(count)]


@given(st.integers(-(2**31), 2**31 - 1), st.integers(-(2**31), 2**31 - 1))
@example(0, -(2**31))
@example(0, 2**31 - 1)
def test_a_step_is_the_same_wherever_the_counter_wraps(start: int, step: int) -> None:
    after = (start + step + 2**31) % 2**32 - 2**31
    assert unwrapped(after - start) == step


@given(st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=5))
def test_the_slowest_speed_is_no_faster_than_any_and_0_where_they_contradict(
    speeds: list[float],
) -> None:
    found = slowest(*speeds)
    if min(speeds) <= 0.0 <= max(speeds):
        assert found == 0.0
    else:
        assert found == min(speeds, key=abs)


# Counts over time.


def test_one_reading_shows_no_speed() -> None:
    assert seen([]).since() is None
    assert seen([(5, 100)]).since() is None


def test_readings_of_the_same_moment_show_no_speed() -> None:
    assert seen([(5, 100), (5, 110)]).since() is None
    assert seen([(4, 90), (5, 100), (5, 110)]).since() is None


def test_a_nanosecond_is_a_time() -> None:
    history = CountHistory(S)
    history.add(5, (100,))
    history.add(6, (110,))
    assert history.since() == (1, (10,))


def test_counts_go_back_over_the_shortest_time_that_is_asked_for() -> None:
    history = seen(steady(30, 10))
    assert history.since() == (10 * MS, (30,))
    assert history.since(20 * MS) == (20 * MS, (60,))
    assert history.since(25 * MS) == (30 * MS, (90,))


def test_counts_go_back_to_where_there_are_enough_of_the_busiest_motor() -> None:
    for way in (1, -1):
        history = CountHistory(S)
        for n in range(20):
            history.add(n * 10 * MS, (n, 5 * way * n))
        assert history.since(0, 100 * MS, 20) == (40 * MS, (4, 20 * way))
        assert history.since(0, 100 * MS, 1000) == (100 * MS, (10, 50 * way))


def test_readings_that_lie_farther_apart_than_the_longest_time_still_show_a_speed() -> None:
    assert seen(steady(100, 500)).since(20 * MS, 100 * MS, 32) == (500 * MS, (100,))


def test_at_rest_counts_go_back_as_far_as_readings_are_kept() -> None:
    history = seen([(n * 10, 7) for n in range(40)], keep_ms=100)
    assert history.since(20 * MS, 50 * MS, 32) == (100 * MS, (0,))
    # Without a wish for counts there is nothing to look for.
    assert history.since(20 * MS) == (20 * MS, (0,))
    # One that counted before has rested for as long as it stands still.
    history = seen([(0, 0), *((10 * n, 5) for n in range(1, 10))])
    assert history.since(20 * MS, 50 * MS, 32) == (50 * MS, (0,))


def test_a_reading_that_was_wrong_is_forgotten() -> None:
    history = seen([(0, 0), (10, 30), (20, 9000)])
    history.drop_latest()
    assert history.since() == (10 * MS, (30,))
    assert history.latest_ns == 10 * MS


def test_after_a_break_nothing_is_known() -> None:
    history = seen(steady(50, 10))
    history.clear()
    assert history.latest_ns is None
    history.drop_latest()
    history.add(2 * S, (1000,))
    assert history.since() is None
    assert history.witnessed(0) is None


# Readings that were sampled within a span.


def test_readings_on_time_prove_nearly_the_speed() -> None:
    history = CountHistory(200 * MS)
    for n in range(10):
        history.add((n * 20 + 4) * MS, (10 * n, -10 * n), earliest_ns=n * 20 * MS)
    assert history.since(40 * MS) == (44 * MS, (20, -20))


def test_a_request_that_was_heard_late_makes_no_wheel_fast() -> None:
    history = CountHistory(200 * MS)
    for n in range(10):
        history.add((n * 20 + 4) * MS, (10 * n,), earliest_ns=n * 20 * MS)
    # Asked at 200 ms, heard at 260 ms: 40 counts more than 20 ms are good for.
    history.add(264 * MS, (130,), earliest_ns=200 * MS)
    found = history.since(40 * MS)
    assert found is not None
    assert found[1][0] / found[0] <= 10 / (20 * MS)


@given(
    st.lists(
        st.tuples(st.integers(1, 100), st.integers(0, 80), st.floats(0.0, 1.0)),
        min_size=2,
        max_size=60,
    )
)
def test_no_more_than_the_true_speed_is_proven(polls: list[tuple[int, int, float]]) -> None:
    """A wheel of 1000 counts in a millisecond, asked at any time, sampled before the answer."""
    history = CountHistory(200 * MS)
    asked_ms = answered_ms = 0
    for wait_ms, late_ms, share in polls:
        asked_ms = max(asked_ms, answered_ms) + wait_ms
        answered_ms = asked_ms + late_ms
        sampled_ms = asked_ms + share * late_ms
        history.add(answered_ms * MS, (int(sampled_ms * 1000),), earliest_ns=asked_ms * MS)
        found = history.since(40 * MS)
        if found is not None:
            assert found[1][0] <= (found[0] / MS) * 1000 * (1.0 + 1e-3)


# What readings agree on.


@pytest.mark.parametrize("period_ms", [5, 10, 20, 50, 100])
def test_an_even_motion_has_its_speed_however_often_it_is_read(period_ms: int) -> None:
    assert seen(steady(3 * period_ms, period_ms, 30)).witnessed(0) == pytest.approx(3000.0)


@pytest.mark.parametrize("period_ms", [5, 10, 20])
@given(wrong=st.sampled_from([-8000, -400, -100, 100, 400, 8000]), which=st.integers(0, 11))
def test_no_reading_alone_makes_a_wheel_fast(period_ms: int, wrong: int, which: int) -> None:
    readings = steady(period_ms, period_ms)
    at_ms, total = readings[which]
    readings[which] = (at_ms, total + wrong)
    found = seen(readings).witnessed(0)
    assert found is None or abs(found) <= 1001.0


@pytest.mark.parametrize("period_ms", [10, 20])
def test_a_wheel_that_begins_to_run_is_agreed_upon_in_80_ms(period_ms: int) -> None:
    readings = steady(0, period_ms)
    begin_ms = readings[-1][0]
    for n in range(1, 100 // period_ms):
        after_ms = n * period_ms
        readings.append((begin_ms + after_ms, round(after_ms * 6.3)))
        if (seen(readings).witnessed(0) or 0.0) > 1900.0:
            assert after_ms <= 80
            return
    pytest.fail("readings never agreed")


def test_few_readings_are_no_witnesses_unless_no_more_can_be_had() -> None:
    assert seen(steady(50, 20, 4)).witnessed(0) is None
    assert seen(steady(250, 100, 2)).witnessed(0) is None
    assert seen(steady(250, 100, 3)).witnessed(0) == pytest.approx(2500.0)


def test_three_readings_over_a_tenth_of_a_second_are_witnesses() -> None:
    assert seen(steady(150, 60, 3)).witnessed(0) == pytest.approx(2500.0)
    assert seen(steady(125, 50, 3)).witnessed(0) == pytest.approx(2500.0)
    assert seen(steady(120, 49, 3)).witnessed(0) is None
    assert seen(steady(625, 250, 3)).witnessed(0) == pytest.approx(2500.0)


def test_five_readings_over_a_fifth_of_a_second_are_witnesses() -> None:
    # Ever faster: without the last, the median pair is that of the first and the fourth.
    ever_faster = [(1000 + 50 * n, 25 * n * n) for n in range(5)]
    assert seen(ever_faster).witnessed(0) == pytest.approx(1500.0)


def test_witnesses_are_no_older_than_80_ms_where_there_are_enough() -> None:
    # It rolled on for long, and then stood: older counts do not matter.
    rolled = [(1000 - 20 * n, -1000 * n) for n in range(8, 0, -1)]
    stood = [(1000 + 20 * n, 0) for n in range(5)]
    assert seen([*rolled, *stood]).witnessed(0) == 0.0
    # Two readings of before count in a row of five.
    assert seen([*rolled, *stood[:3]]).witnessed(0) == pytest.approx(
        seen([*rolled[-2:], *stood[:3]]).witnessed(0)
    )


def test_two_readings_are_kept_however_old_they_are() -> None:
    history = CountHistory(100 * MS)
    for n in range(4):
        history.add(n * 500 * MS, (7,))
    assert history.since(20 * MS, 50 * MS, 32) == (500 * MS, (0,))
    assert seen(steady(7, 10, 5)).latest_ns == 1040 * MS


def test_a_witness_of_80_ms_ago_counts() -> None:
    ever_faster = [(1000 + 16 * n, 100 * n * n) for n in range(6)]
    assert seen(ever_faster).witnessed(0) != seen(ever_faster[1:]).witnessed(0)
    # Without the last, the median pair is that of the first and the last but one.
    assert seen(ever_faster).witnessed(0) == pytest.approx(25_000.0)


def test_readings_25_ms_apart_show_a_speed_and_nearer_ones_do_not() -> None:
    assert seen([(1000 + n, 3 * n) for n in (0, 5, 10, 20, 25)]).witnessed(0) == pytest.approx(3000)
    assert seen([(1000 + n, 3 * n) for n in (0, 5, 10, 20, 24)]).witnessed(0) is None


def test_readings_that_arrive_all_at_once_show_no_speed() -> None:
    assert seen([(1000, 10 * n) for n in range(12)]).witnessed(0) is None


def test_readings_of_before_are_no_witnesses() -> None:
    readings = steady(50, 10)
    last_ms, last = readings[-1]
    readings += [(last_ms + 10 * n, last) for n in range(1, 6)]
    assert seen(readings).witnessed(0, last_ms * MS) == 0.0
    assert seen(readings[:-1]).witnessed(0, last_ms * MS) is None


def test_each_motor_has_witnesses_of_its_own() -> None:
    history = CountHistory(200 * MS, 3)
    for n in range(12):
        history.add(n * 10 * MS, (0, 20 * n))
    assert history.witnessed(0) == 0.0
    assert history.witnessed(1) == pytest.approx(2000.0)
