from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yahboomd.core.model import EncoderReading
from yahboomd.core.odometry.polled_clock import Instant, PolledClock

MS = 1_000_000
START_NS = 1_000_000_000_000


def answer(sent_ns, requested_ns=None, earliest_ns=None):
    return EncoderReading(
        ticks=(0, 0, 0, 0),
        received_ns=sent_ns,
        sent_ns=sent_ns,
        requested_ns=requested_ns,
        earliest_ns=earliest_ns,
    )


def test_a_clock_goes_on_after_the_stamps_of_another():
    last_ns = START_NS + 3 * MS
    assert PolledClock(last_ns).observe(answer(START_NS)).step_ns == 0
    assert PolledClock(last_ns).observe(answer(START_NS + 5 * MS)).stamp_ns > last_ns


def poll(clock, *, requests_known, jitter_ms=16.0, count=500, seed=1):
    """Stamp errors in ms: the board samples 0.4 ms after a request, the answer is held back."""
    chance = random.Random(seed)
    errors, last_ns = [], 0
    for n in range(count):
        requested_ns = START_NS + n * 20 * MS + round(chance.uniform(0.0, 0.3) * MS)
        sampled_ns = requested_ns + 400_000
        sent_ns = sampled_ns + round(chance.uniform(0.0, jitter_ms) * MS)
        instant = clock.observe(answer(sent_ns, requested_ns if requests_known else None))
        assert instant.stamp_ns > last_ns
        last_ns = instant.stamp_ns
        errors.append((instant.stamp_ns - sampled_ns) * 1e-6)
    return errors


def test_the_time_of_the_request_takes_the_jitter_off():
    clock = PolledClock()
    errors = poll(clock, requests_known=True)
    assert max(map(abs, errors[64:])) < 1.0


def test_without_it_a_stamp_is_when_the_answer_left():
    clock = PolledClock()
    errors = poll(clock, requests_known=False, jitter_ms=3.0)
    assert 0.0 <= min(errors) <= max(errors) <= 3.0


def test_an_answer_that_comes_twice_is_one_reading():
    clock = PolledClock()
    clock.observe(answer(START_NS))
    assert clock.observe(answer(START_NS + 20 * MS)).step_ns == 20 * MS
    assert clock.observe(answer(START_NS + 20 * MS)).step_ns == 0


@pytest.mark.parametrize("late_ms", [0, 15, 30, 150])
def test_a_request_that_the_board_heard_late_leaves_time_for_what_was_travelled(late_ms):
    clock = PolledClock()
    for n in range(20):
        requested_ns = START_NS + 20 * n * MS
        clock.observe(answer(requested_ns + 3 * MS, requested_ns))
    last_ns = requested_ns + 3 * MS
    requested_ns += 20 * MS
    sent_ns = requested_ns + (3 + late_ms) * MS
    assert clock.elapsed_at_most_ns(answer(sent_ns, requested_ns)) == sent_ns - last_ns
    needs_ns = 0.9 * (sent_ns - last_ns)
    instant = clock.observe(answer(sent_ns, requested_ns), least_ns=needs_ns)
    assert needs_ns <= instant.step_ns <= sent_ns - last_ns


def test_answers_that_left_before_the_newest_question_are_no_prompt_ones():
    clock = PolledClock()
    for n in range(20):
        asked_ns = START_NS + 20 * n * MS
        clock.observe(answer(asked_ns + 400_000, asked_ns, earliest_ns=asked_ns))
    # They come in one burst. The newest question was not asked when they left.
    for n in range(20):
        left_ns = asked_ns + 1000 * MS + n * 2 * MS
        earliest_ns = asked_ns + 20 * n * MS
        instant = clock.observe(answer(left_ns, left_ns, earliest_ns=earliest_ns))
        assert instant.unsure_ns >= left_ns - earliest_ns - 400_000


def test_answers_of_a_backlog_are_not_taken_for_those_to_the_newest_question():
    clock = PolledClock()
    for n in range(20):
        asked_ns = START_NS + 20 * n * MS
        clock.observe(answer(asked_ns + 400_000, asked_ns, earliest_ns=asked_ns))
    # Each answers the question of 100 ms before, at another distance from the newest one.
    for took_ms in (3, 9, 15, 6, 12, 18):
        asked_ns += 20 * MS
        left_ns = asked_ns + took_ms * MS
        instant = clock.observe(answer(left_ns, asked_ns, earliest_ns=asked_ns - 100 * MS))
        assert instant.stamp_ns == left_ns
        assert instant.unsure_ns >= took_ms * MS - 400_000
    # One that was lost leaves a question too many: the answers are as prompt as before.
    for _ in range(4):
        asked_ns += 20 * MS
        instant = clock.observe(
            answer(asked_ns + 500_000, asked_ns, earliest_ns=asked_ns - 20 * MS)
        )
    assert instant.unsure_ns == 0


def test_the_first_answer_after_a_break_may_have_waited_for_a_process_that_did_not_run():
    clock = PolledClock()
    for n in range(20):
        asked_ns = START_NS + 20 * n * MS
        clock.observe(answer(asked_ns + 400_000, asked_ns, earliest_ns=asked_ns))
    asked_ns += 800 * MS
    first = clock.restart(answer(asked_ns + 9 * MS, asked_ns, earliest_ns=asked_ns))
    assert first.stamp_ns == asked_ns + 400_000


@settings(max_examples=60)
@given(
    answers=st.lists(
        st.tuples(st.integers(1, 120), st.integers(0, 300), st.integers(0, 40)), max_size=60
    )
)
def test_no_stamp_is_later_than_its_answer(answers):
    clock = PolledClock()
    sent_ns = last_ns = START_NS
    for after_ms, asked_ms, least_ms in answers:
        sent_ns += after_ms * MS
        requested_ns = sent_ns - (asked_ms % 25) * MS
        reading = answer(sent_ns, requested_ns, min(requested_ns, sent_ns - asked_ms * MS))
        instant = clock.observe(reading, least_ns=min(least_ms, after_ms) * MS)
        if instant.step_ns:
            assert last_ns < instant.stamp_ns <= sent_ns
            last_ns = instant.stamp_ns


@pytest.mark.parametrize(("late_ms", "unsure"), [(19, False), (21, True)])
def test_an_answer_is_late_beyond_the_worst_latency_of_usb(late_ms, unsure):
    clock = PolledClock()
    for n in range(20):
        asked_ns = START_NS + 20 * n * MS
        clock.observe(answer(asked_ns + 400_000, asked_ns, earliest_ns=asked_ns))
    asked_ns += 100 * MS
    late = clock.observe(answer(asked_ns + 400_000 + late_ms * MS, asked_ns, earliest_ns=asked_ns))
    assert late.unsure_ns == (late_ms * MS if unsure else 0)


@pytest.mark.parametrize(("late_us", "unsure"), [(1_900, False), (2_100, True)])
def test_of_a_backlog_an_answer_is_the_newest_questions_where_it_is_as_fast(late_us, unsure):
    clock = PolledClock()
    for n in range(20):
        asked_ns = START_NS + 20 * n * MS
        clock.observe(answer(asked_ns + 400_000, asked_ns, earliest_ns=asked_ns))
    for late_ns in (0, 0, 0, 0, late_us * 1_000):
        asked_ns += 20 * MS
        sent_ns = asked_ns + 400_000 + late_ns
        instant = clock.observe(answer(sent_ns, asked_ns, earliest_ns=asked_ns - 20 * MS))
    assert instant.unsure_ns == (late_us * 1_000 if unsure else 0)


@pytest.mark.parametrize("usual_us", [400, 15_000])
def test_two_prompt_answers_after_a_backlog_may_be_chance(usual_us):
    clock = PolledClock()
    for n in range(20):
        asked_ns = START_NS + 20 * n * MS
        clock.observe(answer(asked_ns + usual_us * 1_000, asked_ns, earliest_ns=asked_ns))
    unsure = []
    for took_us in (30_000 + usual_us, usual_us, usual_us, usual_us):
        asked_ns += 40 * MS
        before_ns = asked_ns - 40 * MS
        instant = clock.observe(answer(asked_ns + took_us * 1_000, asked_ns, before_ns))
        unsure.append(instant.unsure_ns > 0)
    assert unsure == [True, True, True, False]


def test_time_that_travel_takes_is_a_bound_that_may_just_be_met():
    clock = PolledClock()
    first = clock.observe(answer(START_NS))
    assert first == Instant(START_NS, 0)
    assert clock.observe(answer(START_NS + 20 * MS), least_ns=20.5 * MS).step_ns == 0
    assert clock.observe(answer(START_NS + 20 * MS), least_ns=20.0 * MS).step_ns == 20 * MS
    assert clock.observe(answer(START_NS + 20 * MS + 1)).step_ns == 1


def test_a_request_heard_late_is_stamped_as_late_as_travel_needs_and_no_later():
    clock = PolledClock()
    for n in range(20):
        asked_ns = START_NS + 20 * n * MS
        clock.observe(answer(asked_ns + 400_000, asked_ns, asked_ns))
    asked_ns += 20 * MS
    late = clock.observe(answer(asked_ns + 9 * MS, asked_ns, asked_ns), least_ns=25.0 * MS)
    assert late.step_ns == 25 * MS


def test_the_first_answer_of_a_backlog_may_be_to_any_question():
    clock = PolledClock()
    first = clock.observe(answer(START_NS, START_NS - 5 * MS, START_NS - 100 * MS))
    assert (first.stamp_ns, first.unsure_ns) == (START_NS, 100 * MS)
    alone = PolledClock().observe(answer(START_NS, START_NS - 100 * MS, START_NS - 100 * MS))
    assert alone.unsure_ns == 0


def test_a_break_takes_the_pairing_of_a_backlog_back():
    clock = PolledClock()
    for n in range(20):
        asked_ns = START_NS + 20 * n * MS
        clock.observe(answer(asked_ns + 400_000, asked_ns, asked_ns))
    unsure = []
    for n in range(7):
        asked_ns += 40 * MS
        reading = answer(asked_ns + 400_000, asked_ns, asked_ns - 40 * MS)
        instant = clock.restart(reading) if n == 4 else clock.observe(reading)
        unsure.append(instant.unsure_ns > 0)
    assert unsure == [True, True, False, False, True, True, False]


@pytest.mark.parametrize(
    ("late_us", "unsure_us"),
    [(-1000, 0), (-1001, 38_999), (2000, 0), (2001, 2001), (20_000, 20_000), (20_001, 60_001)],
)
def test_prompt_is_from_a_millisecond_before_the_usual_time_to_the_worst_latency(
    late_us, unsure_us
):
    clock = PolledClock()
    for n in range(20):
        asked_ns = START_NS + 20 * n * MS
        clock.observe(answer(asked_ns + 15 * MS, asked_ns, asked_ns))
    for _ in range(3):
        asked_ns += 40 * MS
        sent_ns = asked_ns + 15 * MS + late_us * 1000
        instant = clock.observe(answer(sent_ns, asked_ns, asked_ns - 40 * MS))
    assert instant.unsure_ns == unsure_us * 1000
