"""The output at which a wheel begins to turn, and the dead zone that a board should add."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.tools.tune.estimates.dead_zone import (
    MARGIN_SHARE,
    MOVED_COUNTS,
    made_up_for,
    turning_output,
)


@given(st.integers(0, 3000), st.sampled_from([1, -1]))
def test_it_is_the_last_output_without_motion(begins, way):
    ramp = [(output, way * max(0, output - begins) // 8) for output in range(0, begins + 200, 16)]
    found = turning_output(ramp)
    assert found is not None
    assert begins - 16 <= found <= begins + 8 * (MOVED_COUNTS + 1)


@pytest.mark.parametrize("ramp", [[], [(0, 0), (3600, 0)], [(0, 0), (3600, MOVED_COUNTS - 1)]])
def test_a_wheel_that_never_turned_has_none(ramp):
    assert turning_output(ramp) is None


def test_a_count_back_and_forth_is_no_motion():
    assert turning_output([(0, 0), (800, 1), (1600, -1), (1700, 0), (1800, 9)]) == 1700


@given(st.lists(st.integers(0, 3600), min_size=1))
def test_a_board_makes_up_for_less_than_the_least_of_its_wheels(turning):
    found = made_up_for(turning, 3600)
    assert 0 <= found <= max(0, min(turning))
    assert found == 0 or min(turning) - found == pytest.approx(MARGIN_SHARE * 3600, abs=0.5)


@pytest.mark.parametrize("way", [1, -1])
def test_as_few_counts_as_are_a_motion_are_one(way):
    ramp = [(100, 0), (200, way * (MOVED_COUNTS - 1)), (300, way * MOVED_COUNTS)]
    assert turning_output(ramp) == 200


def test_a_wheel_that_turns_from_the_first_output_on_began_there():
    assert turning_output([(100, 9), (200, 20), (300, 40)]) == 100
