from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.odometry import discontinuity

OUTCOMES = sorted(discontinuity.COUNTERS)
SPEED_MAX = 2.0


def unknown(outcome, gap_s=3.0, fastest_m_s=0.5):
    return discontinuity.unknown_m(outcome, gap_s, fastest_m_s=fastest_m_s, speed_max_m_s=SPEED_MAX)


def event_of(outcome, lost_m):
    return discontinuity.event(outcome, gap_s=3.0, lost_m=lost_m, counted_m=0.2, unsure_m=0.01)


def test_a_board_that_went_on_counting_lost_nothing():
    assert unknown("gap_kept") == 0.0


@pytest.mark.parametrize("outcome", ["gap_lost", "rebased", "reset_unseen"])
def test_where_nothing_is_known_a_wheel_may_have_rolled_as_fast_as_it_can(outcome):
    assert unknown(outcome, 3.0, fastest_m_s=0.1) == 6.0


def test_before_an_announced_reset_a_wheel_rolled_hardly_faster_than_last_seen():
    assert unknown("reset", 0.4, fastest_m_s=0.5) == pytest.approx(0.24)
    assert unknown("reset", 0.4, fastest_m_s=1.99) == pytest.approx(SPEED_MAX * 0.4)


@given(st.sampled_from(OUTCOMES), st.floats(0.0, 1e6), st.floats(0.0, 10.0))
def test_what_is_unknown_is_never_more_than_a_wheel_can_roll(outcome, gap_s, fastest_m_s):
    assert 0.0 <= unknown(outcome, gap_s, fastest_m_s) <= SPEED_MAX * gap_s


@pytest.mark.parametrize("outcome", OUTCOMES)
def test_what_is_lost_is_a_warning_that_says_how_much(outcome):
    event = event_of(outcome, 1.25)
    assert (event.kind, event.severity) == ("odometry_discontinuity", "warning")
    assert "Up to 1.25 m of each wheel's travel are unknown." in event.message
    assert event.data == {
        "cause": outcome,
        "gap_s": 3.0,
        "unknown_m": 1.25,
        "counted_m": 0.2,
        "unsure_m": 0.01,
    }


@pytest.mark.parametrize("outcome", OUTCOMES)
def test_where_nothing_is_lost_it_is_said_and_no_warning(outcome):
    event = event_of(outcome, 0.0)
    assert (event.kind, event.severity) == ("odometry_bridged", "info")
    assert "unknown" not in event.message


def test_an_event_has_microseconds_and_micrometres():
    event = discontinuity.event(
        "rebased",
        gap_s=1.23456789,
        lost_m=0.123456789,
        counted_m=2.3456789012,
        unsure_m=0.0123456789,
    )
    assert event.data == {
        "cause": "rebased",
        "gap_s": 1.234568,
        "unknown_m": 0.123457,
        "counted_m": 2.345679,
        "unsure_m": 0.012346,
    }
