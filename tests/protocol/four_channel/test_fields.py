from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.protocol.four_channel.fields import (
    INT32_MAX,
    INT32_MIN,
    command,
    decimal,
    four_integers,
    four_speeds,
    integer,
    volts,
)

int32 = st.integers(INT32_MIN, INT32_MAX)

# Each of these is a number to Python.
PYTHONIC = ("+1", " 1", "1 ", "1_0", "\u0661", "1e3", "0x1", "", "-", "--1", "nan", "inf", "1\n")


@given(int32, int32, int32, int32)
def test_four_integers_of_32_bits_come_back(a, b, c, d):
    assert four_integers(f"{a},{b},{c},{d}") == (a, b, c, d)


@pytest.mark.parametrize("text", [*PYTHONIC, "1.0", "12345678901", str(2**31), str(-(2**31) - 1)])
def test_what_printf_would_not_write_is_no_integer(text):
    assert integer(text) is None
    assert four_integers(f"0,{text},0,0") is None


@pytest.mark.parametrize("args", ["", "1", "1,2,3", "1,2,3,", "1,2,3,4,5", ",1,2,3,4", "1;2;3;4"])
def test_other_than_four_numbers_are_refused(args):
    assert four_integers(args) is None
    assert four_speeds(args) is None


def test_speeds_have_two_decimals():
    assert four_speeds("0.00,-15.95,143.51,1000.00") == (0.0, -15.95, 143.51, 1000.0)


@pytest.mark.parametrize("text", [*PYTHONIC, "1", "1.0", "1.000", ".00", "1.", "nan", "-nan"])
def test_other_speeds_are_refused(text):
    assert four_speeds(f"0.00,{text},0.00,0.00") is None


@pytest.mark.parametrize(("text", "value"), [("7.4V", 7.4), ("12.05V", 12.05), ("0.0V", 0.0)])
def test_volts_have_one_or_two_decimals(text, value):
    assert volts(text) == value


@pytest.mark.parametrize("text", ["7V", "7.4", "7.4v", "-7.4V", "7.405V", " 7.4V", "7.4V ", "V"])
def test_other_volts_are_refused(text):
    assert volts(text) is None


@pytest.mark.parametrize(("text", "value"), [("67.000", 67.0), ("67", 67.0), ("-0.060", -0.06)])
def test_decimals_are_plain(text, value):
    assert decimal(text) == value


@pytest.mark.parametrize("text", PYTHONIC)
def test_what_printf_would_not_write_is_no_decimal(text):
    assert decimal(text) is None


@given(st.text(max_size=30))
def test_no_text_raises(text):
    four_integers(text)
    four_speeds(text)
    volts(text)
    integer(text)
    decimal(text)


@given(st.tuples(*[st.integers()] * 4), st.sampled_from([1000, 3600]))
def test_no_number_beyond_the_limit_is_ever_written(units, limit):
    frame = command("spd", units, limit)
    assert frame.startswith(b"$spd:")
    assert frame.endswith(b"#")
    numbers = frame[5:-1].split(b",")
    assert len(numbers) == 4
    assert [int(number) for number in numbers] == [
        unit if abs(unit) <= limit else (limit if unit > 0 else -limit) for unit in units
    ]
    assert max(map(len, numbers)) <= 9


@pytest.mark.parametrize("units", [(), (1, 2, 3), (1, 2, 3, 4, 5)])
def test_other_than_four_numbers_cannot_be_written(units):
    with pytest.raises(ValueError, match="values to unpack"):
        command("spd", units, 1000)


@pytest.mark.parametrize("unit", [0.5, 2000.0, math.nan, math.inf, "1", None])
def test_what_is_no_integer_cannot_be_written(unit):
    with pytest.raises(TypeError, match="integer"):
        command("spd", (0, unit, 0, 0), 1000)


def test_the_largest_and_the_least_number_of_32_bits_are_numbers_and_no_others():
    for value in (INT32_MIN, INT32_MAX):
        assert integer(str(value)) == value
    for value in (INT32_MIN - 1, INT32_MAX + 1):
        assert integer(str(value)) is None
