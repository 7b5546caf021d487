"""A button counts for 0.3 s; once let go, it counts again only for the next movement."""

from __future__ import annotations

import pytest

from yahboomd.simulation.virtual_time import START_NS
from yahboomd.tools.calibrate.hold import HOLD_NS, HeldButton

MS = 1_000_000


class _Clock:
    def __init__(self) -> None:
        self.ns = START_NS

    def now_ns(self) -> int:
        return self.ns


class Button:
    """A button, its time, and the stops that it caused."""

    def __init__(self) -> None:
        self.clock = _Clock()
        self.stops = 0
        self.hold = HeldButton(self.clock, self._stop)  # type: ignore[arg-type]

    def _stop(self) -> None:
        self.stops += 1

    def press(self, age_ns: int = 0) -> None:
        self.hold.press(self.clock.ns - age_ns)


@pytest.fixture
def button() -> Button:
    return Button()


def test_it_counts_for_no_longer_than_its_time_from_the_moment_it_was_held(button: Button) -> None:
    button.hold.offer()
    button.press(age_ns=100 * MS)
    assert button.hold.left_s() == pytest.approx(0.2)
    button.clock.ns += 200 * MS
    assert button.hold.left_s() == 0.0


@pytest.mark.parametrize("age_ns", [HOLD_NS, 10 * HOLD_NS, -1])
def test_a_moment_that_is_old_or_to_come_counts_for_nothing(button: Button, age_ns: int) -> None:
    button.hold.offer()
    button.press(age_ns)
    assert button.hold.left_s() == 0.0


def test_a_gap_ends_the_movement_even_if_the_button_is_held_again(button: Button) -> None:
    button.hold.offer()
    button.press()
    button.clock.ns += HOLD_NS
    button.press()
    assert button.hold.left_s() == 0.0
    button.hold.offer()
    button.press()
    assert button.hold.left_s() > 0.0


def test_letting_go_stops_at_once_and_once(button: Button) -> None:
    button.hold.offer()
    button.press()
    button.hold.release()
    button.hold.release()
    assert (button.stops, button.hold.left_s()) == (1, 0.0)


def test_what_was_pressed_before_a_movement_does_not_begin_it(button: Button) -> None:
    button.hold.offer()
    button.press()
    button.hold.offer()
    assert button.hold.left_s() == 0.0
    button.hold.release()
    assert button.stops == 0
