from __future__ import annotations

import math

import pytest

from yahboomd.errors import BoardError, ConfigError
from yahboomd.protocol.dialect import Reply, Setting, VersionLine
from yahboomd.protocol.framing import Framer
from yahboomd.protocol.registry import DIALECTS
from yahboomd.protocol.settings import (
    PROFILES,
    BoardSettings,
    board_settings,
    check_storable,
    custom_profile,
    problems,
    units_per_m_s,
)

ANSWER = (
    b"read_flash:OK!\r\nMotor_Version:1.7.3\r\nMotor_type:1\r\nDead_Zone:1600\r\nPulse_Line:11\r\n"
    b"Pulse_Phase:30\r\nwheel_diameter:67.000\r\nP:0.800\t I:0.060\t D:0.500\t \r\n"
)
STORED = BoardSettings(
    version="1.7.3",
    motor_type=1,
    deadzone=1600,
    lines=11,
    ratio=30,
    wheel_diameter_mm=67.0,
    pid=(0.8, 0.06, 0.5),
)


def decoded(data):
    return [DIALECTS["streamed"].decode(item) for item in Framer().feed(data)]


def test_the_answer_to_read_flash_becomes_settings():
    assert board_settings(decoded(ANSWER)) == STORED


def test_settings_are_complete_with_the_last_line_and_not_before():
    answers = decoded(ANSWER)
    assert not board_settings(answers[:-1]).is_complete
    assert board_settings(answers[-1:], board_settings(answers[:-1])) == STORED
    assert STORED.is_complete


def test_other_lines_do_not_disturb_the_settings():
    items = [
        Reply(command="mtype", ok=True, text="Set mtype:OK!"),
        Setting(name="lines", value=11),
        VersionLine(version="1.7.3", after_reset=False),
    ]
    assert board_settings(items) == BoardSettings(version="1.7.3", lines=11)


@pytest.mark.parametrize(
    ("name", "motor_type", "deadzone", "ticks", "radius_m"),
    [
        ("520", 1, 1900, 1320.0, 0.0335),
        ("520-1:19", 1, 1900, 836.0, 0.0335),
        ("520-1:56", 1, 1900, 2464.0, 0.0335),
        ("l520", 1, 1900, 1760.0, 0.0335),
        ("310", 2, 1600, 1061.268, 0.024),
        ("tt", 3, 1250, 2340.0, 0.034),
    ],
)
def test_the_profiles_are_the_vendors(name, motor_type, deadzone, ticks, radius_m):
    profile = PROFILES[name]
    assert profile.name == name
    assert (profile.motor_type, profile.deadzone) == (motor_type, deadzone)
    assert profile.ticks_per_revolution == pytest.approx(ticks)
    assert profile.wheel_radius_m == pytest.approx(radius_m)


def test_there_is_no_profile_without_an_encoder():
    assert set(PROFILES) == {"520", "520-1:19", "520-1:56", "l520", "310", "tt"}
    assert all(profile.motor_type != 4 for profile in PROFILES.values())


@pytest.mark.parametrize("name", PROFILES)
def test_every_profile_can_be_stored_and_then_has_no_problem(name):
    check_storable(PROFILES[name].settings)
    assert problems(PROFILES[name].settings, PROFILES[name]) == ()


def test_a_custom_profile_is_built_from_its_figures():
    profile = custom_profile(lines=16, ratio=27.5, wheel_diameter_mm=80.0, motor_type=2)
    assert profile.name == "custom"
    assert profile.ticks_per_revolution == 1760.0
    assert profile.wheel_radius_m == 0.04
    assert profile.settings == BoardSettings(
        motor_type=2, lines=16, ratio=27.5, wheel_diameter_mm=80.0
    )


@pytest.mark.parametrize(
    ("figures", "said"),
    [
        ({"lines": 0}, "encoder lines 0"),
        ({"ratio": 0.0}, "gear ratio 0.0"),
        ({"ratio": math.nan}, "gear ratio nan"),
        ({"wheel_diameter_mm": 0.0}, "wheel diameter 0.0"),
        ({"wheel_diameter_mm": math.inf}, "wheel diameter inf"),
        ({"motor_type": 5}, "motor type 5"),
        ({"motor_type": 4}, "no encoder"),
        ({"deadzone": 3601}, "dead zone 3601"),
        ({"lines": 0, "ratio": 0.0}, "encoder lines 0 .*, gear ratio 0.0"),
    ],
)
def test_an_impossible_custom_profile_is_refused_by_name(figures, said):
    with pytest.raises(ConfigError, match=said):
        custom_profile(**({"lines": 11, "ratio": 30.0, "wheel_diameter_mm": 67.0} | figures))


def test_negative_gains_must_not_be_stored():
    with pytest.raises(ConfigError, match="PID"):
        check_storable(BoardSettings(pid=(0.8, -0.06, 0.5)))


def test_a_board_as_it_was_sold_has_no_problem():
    assert problems(STORED, PROFILES["520"]) == ()


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("lines", "encoder lines"),
        ("ratio", "gear ratio"),
        ("wheel_diameter_mm", "wheel diameter"),
    ],
)
def test_a_zero_forbids_motion(name, what):
    (found,) = problems(STORED.with_value(name, 0), PROFILES["520"])
    assert f"stores 0 as its {what}" in found
    assert "yahboomd probe --write" in found


@pytest.mark.parametrize("stored", [2, 3, 4, 0, 9])
def test_another_motor_type_forbids_motion(stored):
    (found,) = problems(STORED.with_value("motor_type", stored), PROFILES["520"])
    assert f"motor type {stored}" in found
    assert "yahboomd probe --write" in found


def test_what_the_board_did_not_show_forbids_motion():
    found = problems(BoardSettings(version="1.7.3"), PROFILES["520"])
    assert len(found) == 4
    assert all("read its settings again" in sentence for sentence in found)


def test_a_board_that_knows_the_wheel_takes_millimetres_per_second():
    profile = PROFILES["520"]
    units = units_per_m_s(
        STORED,
        radius_m=profile.wheel_radius_m,
        ticks_per_revolution=profile.ticks_per_revolution,
        scale=1.0,
    )
    assert units == pytest.approx(1000.0)


@pytest.mark.parametrize("name", PROFILES)
@pytest.mark.parametrize("scale", [1.0, 0.97])
def test_the_units_make_the_true_wheel_run_at_the_wanted_speed(name, scale):
    # The board's side of it, worked out the other way round: its loop holds counts per second.
    profile = PROFILES[name]
    units = units_per_m_s(
        STORED,
        radius_m=profile.wheel_radius_m,
        ticks_per_revolution=profile.ticks_per_revolution,
        scale=scale,
    )
    board_turns_per_s = units / (math.pi * 67.0)
    ticks_per_s = board_turns_per_s * 11 * 30 * 4
    true_turns_per_s = ticks_per_s / profile.ticks_per_revolution
    assert true_turns_per_s * 2 * math.pi * profile.wheel_radius_m == pytest.approx(scale)


def test_a_board_without_settings_takes_a_thousand_units():
    units = units_per_m_s(None, radius_m=0.03, ticks_per_revolution=999.0, scale=1.02)
    assert units == pytest.approx(1020.0)


@pytest.mark.parametrize("name", ["lines", "ratio", "wheel_diameter_mm"])
@pytest.mark.parametrize("value", [0, None, -1])
def test_a_board_that_believes_nonsense_has_no_command_units(name, value):
    with pytest.raises(BoardError, match="not all known"):
        units_per_m_s(
            STORED.with_value(name, value), radius_m=0.03, ticks_per_revolution=1320.0, scale=1.0
        )
