from __future__ import annotations

import math
from random import Random

import pytest

from yahboomd.core.odometry.line_age import ENOUGH, LineAge

MS = 1_000_000
LINE_NS, TICK_NS = 41 * MS, 10 * MS


def observed(first_ms, speed, lines=200, *, jitter_ms=0.0, lost=0.0, fresh=False, seed=1):
    """A board's lines: the estimate for each, and the truth."""
    random, age = Random(seed), LineAge(LINE_NS, TICK_NS)
    found, before = [], None
    for number in range(lines):
        left_ns = number * LINE_NS + first_ms * MS
        sampled_ns = left_ns if fresh else left_ns // TICK_NS * TICK_NS
        if lost and random.random() < lost:
            continue
        travelled = speed(sampled_ns * 1e-9)
        if before is not None:
            arrival = left_ns + random.uniform(0.0, jitter_ms) * MS
            age.add(float(arrival), abs(round(travelled) - before[1]))
            found.append((age.age_ns, age.step_ns, left_ns - sampled_ns, sampled_ns - before[0]))
        before = (sampled_ns, round(travelled))
    return found


def steady(time_s):
    return 2000.0 * time_s


def wild(time_s):
    return 3000.0 * time_s + 900.0 * math.sin(2.0 * time_s)


@pytest.mark.cases(12)
@pytest.mark.parametrize("first_ms", range(10))
@pytest.mark.parametrize("speed", [steady, wild])
@pytest.mark.parametrize(("jitter_ms", "lost"), [(0.0, 0.0), (8.0, 0.0), (3.0, 0.1)])
def test_ages_and_steps_are_those_of_the_board_soon_and_from_then_on(
    first_ms, speed, jitter_ms, lost
):
    found = observed(first_ms, speed, jitter_ms=jitter_ms, lost=lost)
    known = [each for each in found[60:] if each[0] is not None]
    assert len(known) > 100
    assert all(age_ns == truth_ns for age_ns, _, truth_ns, _ in known)
    assert all(step_ns in {None, truth_ns} for _, step_ns, _, truth_ns in known)


def test_nothing_is_claimed_before_enough_was_seen():
    found = observed(3, steady)
    assert all(age_ns is None for age_ns, *_ in found[: ENOUGH - 1])
    assert found[2 * ENOUGH][0] is not None


def test_of_wheels_that_stand_or_creep_nothing_is_said():
    assert all(age_ns is None for age_ns, *_ in observed(3, lambda _: 0.0))
    assert all(age_ns is None for age_ns, *_ in observed(3, lambda time_s: 100.0 * time_s))


def test_of_a_board_that_reads_its_encoders_for_each_line_no_age_is_claimed():
    assert all(age_ns is None for age_ns, *_ in observed(3, wild, fresh=True))


def test_what_was_learned_is_forgotten_on_demand():
    age = LineAge(LINE_NS, TICK_NS)
    for number in range(60):
        age.add(float(number * LINE_NS), 80 if number % 10 else 100)
    assert age.age_ns is not None
    age.forget()
    assert (age.age_ns, age.step_ns, age.moment) == (None, None, None)


def test_an_age_is_known_with_the_24th_fast_line_and_a_step_with_the_next():
    found = observed(3, steady, lines=30)
    ages = [age_ns is not None for age_ns, *_ in found]
    steps = [step_ns is not None for _, step_ns, *_ in found]
    # The first line only begins.
    assert ages.index(True) == ENOUGH
    assert steps.index(True) == ENOUGH + 1


@pytest.mark.parametrize(("counts", "fast"), [(12, True), (11, False)])
def test_a_line_of_twelve_counts_is_fast(counts, fast):
    age = LineAge(LINE_NS, TICK_NS)
    for number in range(60):
        # By its timer every tenth line has five ticks and not four.
        age.add(float(number * LINE_NS), counts if number % 10 else counts * 5 // 4)
    assert (age.age_ns is not None) is fast


def test_where_lines_were_lost_each_has_to_be_fast():
    age = LineAge(LINE_NS, TICK_NS)
    for number in range(60):
        # Twelve ticks of two counts, or thirteen.
        ticks = 123 * number // 10 - 123 * (number - 1) // 10
        age.add(float(3 * number * LINE_NS), 2 * ticks)
    assert age.age_ns is None


def test_lines_that_are_never_two_fast_ones_in_a_row_say_nothing():
    age = LineAge(LINE_NS, TICK_NS)
    for number in range(100):
        age.add(float(number * LINE_NS), 80 if number % 2 else 2)
    assert age.age_ns is None


def test_a_line_that_is_slow_in_between_says_nothing():
    age = LineAge(LINE_NS, TICK_NS)
    for number in range(150):
        moved = 3 if number % 7 == 0 else 80 if number % 10 else 100
        age.add(float(number * LINE_NS), moved)
    assert age.age_ns == number * LINE_NS % TICK_NS


def test_an_age_that_changed_is_found_again_in_two_seconds():
    age = LineAge(LINE_NS, TICK_NS)
    before_ns = 0
    for number in range(150):
        left_ns = number * LINE_NS
        # The board's timer goes on half a tick later.
        shift_ns = 5 * MS if number > 100 else 0
        sampled_ns = (left_ns - shift_ns) // TICK_NS * TICK_NS + shift_ns
        age.add(float(left_ns), round((sampled_ns - before_ns) * 2000e-9))
        before_ns = sampled_ns
    assert age.age_ns == left_ns - sampled_ns


def test_a_line_moves_the_moment_of_the_next_ones_by_a_tenth_of_its_delay():
    age = LineAge(LINE_NS, TICK_NS)
    for arrival_ms in (0, 41, 87):
        age.add(float(arrival_ms * MS), 80)
    assert age.moment == 82.5 * MS
