from __future__ import annotations

import pytest

from yahboomd.simulation.four_channel.text_times import line_period_ns, printing_ns, saying_ns


@pytest.mark.parametrize(("size", "rate"), [(16, 407), (32, 169), (44, 120), (56, 92)])
def test_longer_lines_come_more_seldom(size: int, rate: int) -> None:
    assert 1e9 / line_period_ns(size, 115200, "measured") == pytest.approx(rate, rel=0.02)


def test_an_answer_occupies_the_board_for_two_copies_of_it_and_a_bare_line_for_one() -> None:
    byte_ns = 10e9 / 115200
    assert saying_ns(25, 115200, "measured") == pytest.approx(46 * byte_ns, abs=10)
    assert saying_ns(25, 115200, "wire") == pytest.approx(23 * byte_ns, abs=10)
    assert saying_ns(0, 115200, "measured") == 0


def test_only_digits_take_time_to_be_printed() -> None:
    assert printing_ns(b"fail,Command not found!") == 0
    assert printing_ns(b"wheel_diameter:67.000") == 5 * printing_ns(b"7") > 0
