from __future__ import annotations

import math

import pytest

from yahboomd.core.odometry.velocity import VelocityEstimator

MS = 1_000_000


@pytest.fixture
def velocity(kit):
    made = VelocityEstimator(kit.differential(), kit.motors())
    made.interrupt((0, 0))
    return made


def run(velocity, path, step_ms=10):
    """Speeds of the left wheel after each step; ``path`` gives its travel in ticks."""
    speeds = []
    for travel in path:
        now = math.floor(travel)
        window = velocity.measure((now, now), step_ms * MS)
        speeds.append(velocity.motor_speeds(window)[0])
    return speeds


def test_a_steady_speed_reads_true_within_one_tick_of_its_window(velocity, kit):
    for speed in (0.01, 0.05, 0.2, 0.5, 1.0):
        fresh = VelocityEstimator(kit.differential(), kit.motors())
        fresh.interrupt((0, 0))
        ticks = speed * 0.010 / kit.tick_m
        read = run(fresh, [ticks * n for n in range(1, 200)])[20:]
        longest_s = 0.1 if ticks * 10 < 32 else 0.02
        assert all(abs(each - speed) <= kit.tick_m / longest_s for each in read)


def test_a_slow_wheel_does_not_read_as_standing_and_darting(velocity, kit):
    # One tick every 30 ms: 5.3 mm/s, while a single sample shows 0 or 16.
    read = run(velocity, [n / 3 for n in range(1, 300)])[20:]
    assert min(read) > 0.0
    assert max(read) - min(read) <= 1.01 * kit.tick_m / 0.1


def test_fast_motion_is_measured_over_twenty_milliseconds(velocity, kit):
    run(velocity, [40 * n for n in range(1, 50)])
    stopped = [40 * 49] * 2
    assert run(velocity, stopped)[-1] < 0.5 * 40 * kit.tick_m / 0.010


def test_a_wheel_that_stopped_reads_zero_within_the_longest_window(velocity):
    read = run(velocity, [40 * n for n in range(1, 50)] + [40 * 49] * 10)
    assert read[-1] == 0.0


def test_unequal_steps_are_divided_by_their_own_time(velocity, kit):
    ticks, total = 30, 0
    read = []
    for step_ms in [10, 30, 20, 10, 10, 40] * 10:
        total += ticks * step_ms // 10
        read.append(velocity.motor_speeds(velocity.measure((total, total), step_ms * MS))[0])
    assert read == pytest.approx([ticks * kit.tick_m / 0.010] * len(read))


def test_readings_farther_apart_than_the_window_still_give_a_speed(velocity, kit):
    read = run(velocity, [1000 * n for n in range(1, 5)], step_ms=500)
    assert read == pytest.approx([1000 * kit.tick_m / 0.5] * 4)


def test_an_interruption_is_not_looked_across(velocity):
    run(velocity, [40 * n for n in range(1, 50)])
    velocity.interrupt((5000, 5000))
    window = velocity.measure((5000, 5000), 10 * MS)
    assert velocity.motor_speeds(window) == (0.0, 0.0)


def test_without_two_readings_there_is_no_speed(kit):
    velocity = VelocityEstimator(kit.differential(), kit.motors())
    window = velocity.measure((7, 7), 10 * MS)
    assert window.span_ns == 0
    assert velocity.motor_speeds(window) == (0.0, 0.0)
    assert velocity.twist(window).is_zero


def test_the_twist_is_that_of_the_wheels(velocity, kit):
    for n in range(1, 10):
        window = velocity.measure((30 * n, 40 * n), 10 * MS)
    twist = velocity.twist(window)
    left, right = velocity.motor_speeds(window)
    assert twist.vx == pytest.approx((left + right) / 2)
    assert twist.vy == 0.0
    assert twist.wz == pytest.approx((right - left) / kit.track_m)


def test_a_speed_is_as_uncertain_as_the_moment_at_which_it_begins(velocity):
    velocity.interrupt((0, 0), rough_ns=4 * MS)
    assert velocity.measure((40, 40), 20 * MS).rough_ns == 4 * MS
    assert velocity.measure((80, 80), 20 * MS).rough_ns == 0


def test_counters_that_stay_just_after_a_rough_beginning_are_no_standstill(velocity):
    velocity.interrupt((7, 7), rough_ns=4 * MS)
    assert velocity.measure((7, 7), 10 * MS).span_ns == 0
    assert velocity.measure((7, 7), 10 * MS).span_ns == 0
    assert velocity.measure((7, 7), 10 * MS).span_ns == 30 * MS


def test_counts_over_other_than_whole_ticks_may_be_those_of_one_tick_more(velocity):
    velocity.tick_ns = 10 * MS
    velocity.interrupt((0, 0))
    assert velocity.measure((80, 80), 40 * MS).rough_ns == 0
    assert velocity.measure((170, 170), 45 * MS).rough_ns == 5 * MS
    assert velocity.measure((250, 250), 49 * MS).rough_ns == 3 * MS


def test_one_unseen_tick_more_or_less_is_a_quarter_of_the_speed_at_most(velocity, kit):
    velocity.tick_ns = 10 * MS
    velocity.interrupt((0, 0))
    total, read = 0, []
    # Asked every 20 ms, exactly when the counters are renewed.
    for ticks in [2] * 10 + [3, 1, 2, 3, 2, 1, 2] * 5:
        total += 40 * ticks
        read.append(velocity.motor_speeds(velocity.measure((total, total), 20 * MS))[0])
    true = 40 * kit.tick_m / 0.010
    assert all(0.75 * true <= each <= 1.25 * true + 1e-9 for each in read[2:])


def test_a_speed_is_as_uncertain_as_the_period_that_it_is_taken_with(velocity):
    velocity.doubt = 0.5
    assert velocity.measure((40, 40), 20 * MS).rough_ns == 10 * MS


@pytest.mark.parametrize(
    ("ways", "twist"),
    [((1, 1, 1, 1), (1, 0, 0)), ((-1, 1, -1, 1), (0, 1, 0)), ((-1, -1, 1, 1), (0, 0, 5))],
)
def test_a_twist_is_what_the_wheels_make_of_it_in_every_direction(kit, ways, twist):
    velocity = VelocityEstimator(kit.mecanum(), kit.motors((0, 1, 2, 3)))
    velocity.interrupt((0, 0, 0, 0))
    for n in range(1, 6):
        window = velocity.measure(tuple(60 * n * way for way in ways), 20 * MS)
    found = velocity.twist(window)
    rim_m_s = 60 * kit.tick_m / 0.020
    assert (found.vx, found.vy, found.wz) == pytest.approx([rim_m_s * each for each in twist])
