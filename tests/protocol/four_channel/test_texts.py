from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.protocol.dialect import CommandLost, Reply, Setting, Unrecognised, VersionLine
from yahboomd.core.protocol.four_channel.texts import decode_text


@pytest.mark.parametrize(
    ("text", "command"),
    [
        ("Set mtype:OK!", "mtype"),
        ("Set deadzone:OK!", "deadzone"),
        ("Set mline:OK!", "mline"),
        ("Set mphase:OK!", "mphase"),
        ("Set wdiameter:OK!", "wdiameter"),
        ("Set MPID:OK!", "MPID"),
        ("read_flash:OK!", "read_flash"),
    ],
)
def test_an_ok_names_the_command_it_answers(text, command):
    follow = command == "read_flash"
    assert decode_text(text) == Reply(command=command, ok=True, text=text, settings_follow=follow)


def test_the_misspelt_answer_names_the_command_as_it_is_sent():
    text = "falsh_reset:OK!"
    assert decode_text(text) == Reply(command="flash_reset", ok=True, text=text)


def test_a_refused_type_answers_mtype():
    text = "fail,type error!"
    assert decode_text(text) == Reply(command="mtype", ok=False, text=text)


def test_an_unknown_refusal_names_no_command():
    text = "fail,something new!"
    assert decode_text(text) == Reply(command="", ok=False, text=text)


@pytest.mark.parametrize("text", ["fail,Command not found!", "fail,command is long!"])
def test_a_command_that_did_not_arrive_whole_is_lost(text):
    assert decode_text(text) == CommandLost(text=text)


@pytest.mark.parametrize(
    ("text", "after_reset"),
    [
        ("Motor_Version:1.7.3", None),
        ("Reset MCUMotor_Version:1.7.3", True),
        ("Reset MCU\rMotor_Version:1.7.3", True),
        ("$MAll:1,2,3Reset MCUMotor_Version:1.7.3", True),
        ("$MAll:1,2,3Motor_Version:1.7.3", None),
        ("\ufffd\x00Motor_Version:1.7.3 ", None),
        ("fail,CommMotor_Version:1.7.3", None),
    ],
)
def test_a_version_is_found_anywhere_in_a_line(text, after_reset):
    assert decode_text(text) == VersionLine(version="1.7.3", after_reset=after_reset)


@pytest.mark.parametrize(
    ("text", "name", "value"),
    [
        ("Motor_type:1", "motor_type", 1),
        ("Dead_Zone:1600", "deadzone", 1600),
        ("Pulse_Line:11", "lines", 11),
        ("Pulse_Phase:30", "ratio", 30),
        ("Pulse_Phase:0", "ratio", 0),
        ("wheel_diameter:67.000", "wheel_diameter_mm", 67.0),
        ("P:0.800\t I:0.060\t D:0.500\t ", "pid", (0.8, 0.06, 0.5)),
    ],
)
def test_a_line_of_the_settings_gives_its_value(text, name, value):
    assert decode_text(text) == Setting(name=name, value=value, last=name == "pid")


def test_a_number_that_the_flash_has_lost_is_none_and_equals_itself():
    text = "P:0.800\t I:nan\t D:-nan\t "
    assert decode_text(text) == decode_text(text)
    p, i, d = decode_text(text).value
    assert p == 0.8
    assert math.isnan(i)
    assert math.isnan(d)
    assert math.isnan(decode_text("wheel_diameter:nan").value)
    assert math.isnan(decode_text("wheel_diameter:-680564693277057680000000000.000").value)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "Reset MCU",
        "Set mty",
        "et mtype:O!",
        "Set mt\ufffdpe:OK!",
        "$MAll:1,2Set mtype:OK!",
        "fail,Command not fou",
        "Pulse_Line:",
        "Pulse_Line:1 1",
        "Pulse_Line:1_1",
        "Pulse_Line:11.0",
        "Pulse_Line:99999999999",
        "Other_Line:11",
        "wheel_diameter:na",
        "Pulse_Line:nan",
        "P:0.800\t I:0.060\t D:",
        "P:0.800\t I:0.0.6\t D:0.500\t ",
        "Grbl 1.1f ['$' for help]",
        "1,2,3,4",
    ],
)
def test_a_piece_of_a_line_means_nothing(text):
    assert decode_text(text) == Unrecognised(text=text)


@given(st.text(max_size=60))
def test_no_text_raises(text):
    decode_text(text)
