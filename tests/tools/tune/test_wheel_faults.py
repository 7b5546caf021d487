"""Reports of wheels that do not follow, by their counts alone."""

from __future__ import annotations

import pytest

from yahboomd.core.errors import BoardError
from yahboomd.core.model import Counts, Motor
from yahboomd.tools.tune import wheel_faults

LEFT = Motor(name="left", wheel=0, position=1, radius_m=0.05, ticks_per_revolution=1000.0)
RIGHT = Motor(
    name="right", wheel=1, position=3, encoder_sign=-1, radius_m=0.05, ticks_per_revolution=1000.0
)
A_METRE = round(1.0 / LEFT.metres_per_tick)


def found(left: float, right: float, waited_s: float = 0.5, *, ramped: bool = False) -> str:
    """The report of both wheels after these metres, at 0.4 m/s."""
    counted: Counts = (round(left * A_METRE), 0, -round(right * A_METRE), 0)
    return wheel_faults.found((LEFT, RIGHT), (0.4, 0.4), counted, waited_s, ramped=ramped)


@pytest.mark.parametrize(
    ("metres", "words"),
    [
        ((0.2, 0.2), ""),
        ((0.1, -0.015), ""),
        ((0.1, -0.03), "right (M3) turned against its command; the motors were cut."),
        ((0.2, 0.5), "right (M3) ran at 1.00 m/s instead of 0.40 m/s; the motors were cut."),
        ((0.0, 0.11), ""),
        ((0.0, 0.13), "left (M1) stood while another wheel turned; the motors were cut."),
    ],
)
def test_the_first_wheel_that_does_not_follow_is_named(metres, words: str) -> None:
    assert found(*metres).startswith(words)
    assert bool(found(*metres)) == bool(words)


def test_a_wheel_that_stands_is_no_fault_where_the_stored_dead_zone_may_be_too_small() -> None:
    counted: Counts = (round(0.2 * A_METRE), 0, 0, 0)
    for may_stand in (False, True):
        words = wheel_faults.found(
            (LEFT, RIGHT), (0.4, 0.4), counted, 0.5, ramped=True, may_stand=may_stand
        )
        assert bool(words) != may_stand


def test_wheels_that_never_counted_have_time_to_begin() -> None:
    assert not found(0.0, 0.0, 1.1)
    assert "left (M1) did not turn within 1.2 s" in found(0.0, 0.0, 1.3)
    assert not found(0.0, 0.0, 1.3, ramped=True)


def test_only_the_wheel_that_is_driven_may_turn() -> None:
    wheel_faults.check_alone(LEFT, (LEFT, RIGHT), (500, 0, -12, 0))
    with pytest.raises(BoardError, match=r"right .* turned while left alone was driven"):
        wheel_faults.check_alone(LEFT, (LEFT, RIGHT), (500, 0, -13, 0))
