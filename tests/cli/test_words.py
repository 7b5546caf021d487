from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.tools.terminal import words


@pytest.mark.parametrize(
    ("s", "said"),
    [
        (0.0, "0.0 s"),
        (59.96, "59.9 s"),
        (60.0, "1 min 00 s"),
        (185.9, "3 min 05 s"),
        (7620.0, "2 h 07 min"),
        (200_000.0, "2 days"),
    ],
)
def test_durations_are_said_as_people_say_them(s: float, said: str) -> None:
    assert words.duration(s) == said


@given(st.floats(-1e4, 1e4))
def test_a_heading_in_degrees_is_wrapped_and_never_a_negative_zero(theta: float) -> None:
    said = words.degrees(theta)
    assert -180.0 <= float(said.rstrip("°")) <= 180.0
    assert said != "-0.0°"


def test_a_heading_keeps_its_sign_within_half_a_turn() -> None:
    assert words.degrees(math.pi / 2 - 4 * math.pi) == "90.0°"
    assert words.degrees(-math.pi / 2) == "-90.0°"


@pytest.mark.parametrize(
    ("text", "value"), [("1", 1.0), (" -.5 ", -0.5), ("+2.", 2.0), ("1e-3", 0.001)]
)
def test_a_decimal_number_is_read(text: str, value: float) -> None:
    assert words.decimal(text) == value


@pytest.mark.parametrize("text", ["", "1_0", "0,5", "inf", "nan", "1e999", "0x1", "\u0661", "1 2"])
def test_what_else_python_reads_as_a_number_is_none(text: str) -> None:
    assert math.isnan(words.decimal(text))
