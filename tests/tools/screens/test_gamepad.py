"""A gamepad's records, as the kernel writes them."""

from __future__ import annotations

import pytest
from gamepad_records import axis, button, records
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.tools.screens.gamepad import (
    EAST,
    HAT_Y,
    LEFT_SHOULDER,
    RIGHT_SHOULDER,
    RIGHT_X,
    START,
    STICK_X,
    STICK_Y,
    Gamepad,
)


def test_the_sticks_drive_forward_turn_and_go_sideways_by_their_share() -> None:
    pad = Gamepad()
    assert pad.shares == (0.0, 0.0, 0.0)
    pad.feed(axis(STICK_Y, -32768) + axis(STICK_X, 32767) + axis(RIGHT_X, -32768))
    assert pad.shares == (1.0, 1.0, -1.0)
    # Half of what lies beyond the rest.
    pad.feed(axis(STICK_Y, round(0.55 * 32768)))
    assert pad.shares[0] == pytest.approx(-0.5, abs=0.001)


def test_around_its_middle_a_stick_is_at_rest() -> None:
    pad = Gamepad()
    for value in (-3000, -1, 0, 1, 3000):
        pad.feed(axis(STICK_Y, value))
        assert pad.shares == (0.0, 0.0, 0.0)


def test_one_shoulder_has_to_be_held_and_the_first_that_is_let_go_ends_it() -> None:
    pad = Gamepad()
    assert not pad.held
    assert pad.feed(button(LEFT_SHOULDER, 1)) == []
    assert pad.held
    pad.feed(button(RIGHT_SHOULDER, 1))
    assert pad.feed(button(LEFT_SHOULDER, 0)) == ["let_go"]
    assert not pad.held
    # One that is down already is reported as repeated: it was not pressed.
    pad.feed(button(RIGHT_SHOULDER, 2))
    assert not pad.held


def test_the_other_buttons_have_their_meanings_and_end_the_hold_or_not() -> None:
    pad = Gamepad()
    pad.feed(button(LEFT_SHOULDER, 1))
    assert pad.feed(axis(HAT_Y, -1) + axis(HAT_Y, 0) + axis(HAT_Y, 1)) == ["faster", "slower"]
    assert pad.held
    assert pad.feed(button(EAST, 1) + button(EAST, 0)) == ["estop"]
    assert not pad.held
    pad.feed(button(LEFT_SHOULDER, 1))
    assert pad.feed(button(START, 1)) == ["release"]
    assert not pad.held


def test_when_the_kernel_lost_records_nothing_is_held() -> None:
    pad = Gamepad()
    pad.feed(button(LEFT_SHOULDER, 1))
    assert pad.feed(records((0, 3, 0))) == ["let_go"]
    assert not pad.held


@given(st.binary(max_size=200), st.integers(0, 200))
def test_no_bytes_raise_and_no_split_changes_what_they_mean(data: bytes, cut: int) -> None:
    whole, split = Gamepad(), Gamepad()
    wishes = whole.feed(data)
    assert split.feed(data[:cut]) + split.feed(data[cut:]) == wishes
    assert (split.held, split.shares) == (whole.held, whole.shares)
    assert all(-1.0 <= share <= 1.0 for share in whole.shares)
