"""The outputs at which a wheel begins to turn and stops, and the dead zone a board should add."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.tools.tune.estimates.dead_zone import (
    MARGIN_SHARE,
    MOVED_COUNTS,
    Ramp,
    RampSample,
    made_up_for,
    stopping_output,
    turning_output,
)


def ramp(samples: list[tuple[int, int]]) -> Ramp:
    """Outputs and counts, 20 ms apart."""
    return [RampSample(0.02 * tick, *sample) for tick, sample in enumerate(samples)]


@given(st.integers(0, 3000))
def test_it_is_the_last_output_without_motion(begins):
    found = turning_output(
        ramp([(output, max(0, output - begins) // 8) for output in range(0, begins + 200, 16)])
    )
    assert found is not None
    assert begins - 16 <= found <= begins + 8 * (MOVED_COUNTS + 1)


@pytest.mark.parametrize("samples", [[], [(0, 0), (3600, 0)], [(0, 0), (3600, MOVED_COUNTS - 1)]])
def test_a_wheel_that_never_turned_has_none(samples):
    assert turning_output(ramp(samples)) is None


def test_a_count_back_and_forth_is_no_motion():
    assert turning_output(ramp([(0, 0), (800, 1), (1600, -1), (1700, 0), (1800, 9)])) == 1700


@given(st.lists(st.integers(0, 3600), min_size=1))
def test_a_board_makes_up_for_less_than_the_least_of_its_wheels(stopping):
    found = made_up_for(stopping, 3600)
    assert 0 <= found <= max(0, min(stopping))
    assert found == 0 or min(stopping) - found == pytest.approx(MARGIN_SHARE * 3600, abs=0.5)


def test_as_few_counts_as_are_a_motion_are_one():
    assert turning_output(ramp([(100, 0), (200, MOVED_COUNTS - 1), (300, MOVED_COUNTS)])) == 200


def test_a_wheel_that_turns_from_the_first_output_on_began_there():
    assert turning_output(ramp([(100, 9), (200, 20), (300, 40)])) == 100


def test_a_wheel_stops_at_the_output_of_its_last_motion():
    # A count back and forth, as on the edge of one, is none.
    fall = ramp([(1800, 90), (1600, 140), (1500, 160), (1450, 163), (1400, 164), (1350, 163)])
    assert stopping_output(fall) == 1500


@given(st.integers(800, 1590), st.integers(1, 9))
def test_where_the_least_output_turns_it_two_speeds_give_where_it_would_stop(friction, per_ms):
    def turned(output: int, tick: int) -> int:
        # A reading that came late has more counts; of the speed, the whole time tells.
        return (output - friction) * per_ms * tick + 100 * (tick in {16, 28})

    held = [(1601, turned(1601, tick)) for tick in range(30)]
    above = [(1901, held[-1][1] + turned(1901, tick)) for tick in range(30)]
    assert stopping_output(ramp([(2200, 0), *held, *above])) == pytest.approx(friction, abs=1)
