from __future__ import annotations

from yahboomd.cli.screens.view import LINK_COUNTS, REFUSALS, View, WheelView
from yahboomd.messages import status_fields


def test_every_reason_to_refuse_a_command_has_words() -> None:
    assert set(REFUSALS) == set(status_fields.REFUSALS)


def test_every_trouble_of_the_line_is_a_counter_of_the_status() -> None:
    counters = status_fields.ZEROS["link"] | status_fields.ZEROS["command"]
    assert {name for group in LINK_COUNTS.values() for name in group} <= set(counters)


def test_no_counter_is_shown_twice() -> None:
    names = [name for group in LINK_COUNTS.values() for name in group]
    assert len(names) == len(set(names))


def test_old_wheels_do_not_move() -> None:
    wheel = WheelView(name="left", ticks=0, position_rad=0.0, speed_m_s=0.5, command_m_s=0.5)
    assert View(phase="live", wheels=(wheel,)).moving
    assert not View(phase="live", wheels=(wheel,), late=True).moving
