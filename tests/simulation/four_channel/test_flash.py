from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.simulation.four_channel.flash import (
    SETTINGS,
    FlashContent,
    SettingRefused,
    changed,
    confirmation,
    decimal,
    mm_s_per_tick,
    report,
    short,
    tuning,
    whole,
)


@pytest.mark.parametrize(
    ("text", "number"),
    [(b"12", 12), (b" -7x", -7), (b"", 0), (b"x", 0), (b"3.9", 3), (b"99999999999", 2**31 - 1)],
)
def test_whole_numbers_read_as_in_c(text: bytes, number: int) -> None:
    assert whole(text) == number


@pytest.mark.parametrize(
    ("text", "number"),
    [(b"67.5", 67.5), (b".5", 0.5), (b"", 0.0), (b"-1e3", -1000.0), (b"1e", 1.0)],
)
def test_decimal_numbers_read_as_in_c(text: bytes, number: float) -> None:
    assert decimal(text) == number


def test_sixteen_bits_wrap() -> None:
    assert [short(n) for n in (32767, 32768, 40000, 100100)] == [32767, -32768, -25536, -30972]


def test_zeros_and_empty_arguments_are_stored() -> None:
    content = FlashContent()
    assert changed(content, b"mline", b"0") == FlashContent(lines=0)
    assert changed(content, b"mphase", b"") == FlashContent(ratio=0)
    assert changed(content, b"wdiameter", b"") == FlashContent(wheel_diameter_mm=0.0)


def test_decimals_of_the_ratio_are_cut() -> None:
    assert changed(FlashContent(), b"mphase", b"20.409") == FlashContent(ratio=20)


@pytest.mark.parametrize("args", [b"0", b"5", b"", b"-1"])
def test_a_type_that_does_not_exist_is_refused(args: bytes) -> None:
    assert changed(FlashContent(), b"mtype", args) == SettingRefused(b"fail,type error!")


@given(st.sampled_from(SETTINGS), st.binary(max_size=60))
def test_whatever_is_stored_can_be_reported_and_regulated_with(name: bytes, args: bytes) -> None:
    content = changed(FlashContent(), name, args)
    if isinstance(content, FlashContent):
        assert report(content, "1.7.3").endswith(b"\r\n")
        tuning(content, 1)


def test_the_report_is_the_boards_own_text() -> None:
    assert report(FlashContent(), "1.7.3").decode().split("\r\n") == [
        "read_flash:OK!",
        "Motor_Version:1.7.3",
        "Motor_type:1",
        "Dead_Zone:1600",
        "Pulse_Line:11",
        "Pulse_Phase:30",
        "wheel_diameter:67.000",
        "P:0.800\t I:0.060\t D:0.500\t ",
        "",
    ]


def test_one_count_in_ten_milliseconds_is_15_946_mm_s() -> None:
    assert mm_s_per_tick(FlashContent()) == pytest.approx(15.946, abs=5e-4)


@pytest.mark.parametrize("zero", ["lines", "ratio", "wheel_diameter_mm"])
def test_a_zero_makes_the_board_measure_nothing(zero: str) -> None:
    assert mm_s_per_tick(FlashContent(**{zero: 0})) == 0.0


def test_old_firmware_says_nothing_about_the_dead_zone() -> None:
    assert confirmation(b"deadzone", "1.6.5") == b""
    assert confirmation(b"deadzone", "1.7.3") == b"Set deadzone:OK!\r\n"
    assert confirmation(b"mline", "1.6.5") == b"Set mline:OK!\r\n"
