from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.drive.witnesses import Witnesses

MS = 1_000_000
METRES_PER_TICK = 2 * math.pi * 0.0335 / 1320


def heard(readings: list[tuple[int, int]]) -> Witnesses:
    """One that heard these totals, each with its time in milliseconds."""
    witnesses = Witnesses(METRES_PER_TICK)
    before = readings[0][1]
    for at_ms, total in readings:
        witnesses.hear(at_ms * MS, total - before)
        before = total
    return witnesses


def steady(per_reading: int, period_ms: int, count: int = 12) -> list[tuple[int, int]]:
    return [(1000 + n * period_ms, n * per_reading) for n in range(count)]


@pytest.mark.parametrize("period_ms", [5, 10, 20, 50, 100])
def test_an_even_motion_has_its_speed_however_often_it_is_read(period_ms: int) -> None:
    truth = 3 * METRES_PER_TICK * 1e3
    readings = steady(3 * period_ms, period_ms, 30)
    assert heard(readings).speed_m_s() == pytest.approx(truth)


@pytest.mark.parametrize("period_ms", [5, 10, 20])
@given(wrong=st.sampled_from([-8000, -400, -100, 100, 400, 8000]), which=st.integers(0, 11))
def test_no_reading_alone_makes_a_wheel_fast(period_ms: int, wrong: int, which: int) -> None:
    readings = steady(period_ms, period_ms)
    at_ms, total = readings[which]
    readings[which] = (at_ms, total + wrong)
    found = heard(readings).speed_m_s()
    assert found is None or abs(found) <= METRES_PER_TICK * 1e3 * 1.001


@pytest.mark.parametrize("period_ms", [10, 20])
def test_a_wheel_that_begins_to_run_is_agreed_upon_in_80_ms(period_ms: int) -> None:
    readings = steady(0, period_ms)
    begin_ms = readings[-1][0]
    per_ms = 1.0 / METRES_PER_TICK / 1e3
    for n in range(1, 100 // period_ms):
        after_ms = n * period_ms
        readings.append((begin_ms + after_ms, round(after_ms * per_ms)))
        if (heard(readings).speed_m_s() or 0.0) > 0.3:
            assert after_ms <= 80
            return
    pytest.fail("nobody agreed")


def test_few_readings_tell_nothing_unless_no_more_can_be_had() -> None:
    assert heard(steady(50, 20, 4)).speed_m_s() is None
    assert heard(steady(250, 100, 2)).speed_m_s() is None
    assert heard(steady(250, 100, 3)).speed_m_s() == pytest.approx(2.5 * METRES_PER_TICK * 1e3)


def test_readings_that_arrive_all_at_once_tell_no_speed() -> None:
    assert heard([(1000, 10 * n) for n in range(12)]).speed_m_s() is None


def test_what_was_heard_before_is_forgotten_when_told() -> None:
    witnesses = heard(steady(50, 10))
    witnesses.forget()
    assert witnesses.speed_m_s() is None
