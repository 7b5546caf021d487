from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.errors import BoardError, ConfigError
from yahboomd.core.protocol.four_channel.stored import TABLE, findings, units_per_m_s
from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.core.protocol.settings import (
    BoardSettings,
    SettingWrite,
    check_storable,
    is_complete,
    writes,
)

LONGEST = 53
"""51 characters between ``$`` and ``#``."""

STORED = BoardSettings(
    version="1.7.3",
    motor_type=1,
    deadzone=1600,
    lines=11,
    ratio=30,
    wheel_diameter_mm=67.0,
    pid=(0.8, 0.06, 0.5),
)


def test_settings_are_complete_with_every_value_and_the_version():
    assert is_complete(TABLE, STORED)
    for field in STORED:
        assert not is_complete(TABLE, {key: STORED[key] for key in STORED if key != field})


@pytest.mark.parametrize(
    ("change", "frame", "reply_to", "text"),
    [
        ({"motor_type": 2}, b"$mtype:2#", "mtype", "motor type 2"),
        ({"deadzone": 1900}, b"$deadzone:1900#", "deadzone", "dead zone 1900"),
        ({"lines": 13}, b"$mline:13#", "mline", "encoder lines 13"),
        ({"ratio": 40.0}, b"$mphase:40#", "mphase", "gear ratio 40"),
        (
            {"wheel_diameter_mm": 48.5},
            b"$wdiameter:48.500#",
            "wdiameter",
            "wheel diameter 48.500 mm",
        ),
    ],
)
def test_only_the_value_that_differs_is_written(change, frame, reply_to, text):
    want = STORED | change
    assert writes(TABLE, STORED, want) == (
        SettingWrite(frame=frame, text=text, reply_to=reply_to, timeout_s=0.4, resets=False),
    )


def test_new_gains_come_last_reset_the_board_and_get_a_second():
    want = STORED | BoardSettings(pid=(0.9, 0.06, 0.5), lines=13)
    *_, last = writes(TABLE, STORED, want)
    assert last == SettingWrite(
        frame=b"$MPID:0.900,0.060,0.500#",
        text="gains P, I, D 0.900,0.060,0.500",
        reply_to="MPID",
        timeout_s=1.0,
        resets=True,
    )


def test_a_profile_is_written_value_by_value_in_the_vendors_order():
    found = writes(TABLE, STORED, PROFILES["310"].settings)
    assert [write.frame for write in found] == [
        b"$mtype:2#",
        b"$mline:13#",
        b"$mphase:20#",
        b"$wdiameter:48.000#",
    ]
    assert all(write.timeout_s >= 0.4 for write in found)


def test_decimals_that_the_board_cannot_show_are_no_difference():
    have = BoardSettings(ratio=20, wheel_diameter_mm=67.123, pid=(0.8, 0.06, 0.5))
    want = BoardSettings(ratio=20.409, wheel_diameter_mm=67.1234, pid=(0.8002, 0.06, 0.49998))
    assert writes(TABLE, have, want) == ()


def test_what_the_board_did_not_show_is_not_written():
    assert writes(TABLE, BoardSettings(), PROFILES["520"].settings) == ()


def test_a_zero_is_never_written():
    with pytest.raises(ConfigError, match="encoder lines 0"):
        writes(TABLE, STORED, BoardSettings(lines=0))


@given(
    st.builds(
        BoardSettings,
        motor_type=st.integers(1, 4),
        deadzone=st.integers(0, 3600),
        lines=st.integers(1, 65_534),
        ratio=st.floats(1.0, 10_000.0),
        wheel_diameter_mm=st.floats(1.0, 10_000.0),
        pid=st.tuples(*[st.floats(0.0, 1000.0)] * 3),
    )
)
def test_once_a_board_shows_what_was_written_nothing_differs(want):
    # The board cuts the ratio to whole numbers and prints the rest with three decimals.
    shown = {}
    for write in writes(TABLE, STORED, want):
        assert len(write.frame) <= LONGEST
        shown[write.reply_to] = write.frame.decode().split(":")[1].rstrip("#")
    have = STORED | BoardSettings(
        motor_type=int(shown.get("mtype", 1)),
        deadzone=int(shown.get("deadzone", 1600)),
        lines=int(shown.get("mline", 11)),
        ratio=int(shown.get("mphase", 30)),
        wheel_diameter_mm=float(shown.get("wdiameter", "67.000")),
        pid=tuple(float(gain) for gain in shown.get("MPID", "0.800,0.060,0.500").split(",")),
    )
    assert writes(TABLE, have, want) == ()


def test_the_limits_of_what_is_stored_are_the_boards():
    assert {row.field: (row.least, row.most) for row in TABLE} == {
        "motor_type": (1, 4),
        "deadzone": (0, 3600),
        "lines": (1, 65_534),
        "ratio": (1, 10_000),
        "wheel_diameter_mm": (1, 10_000),
        "pid": (0, 1000),
    }


@pytest.mark.parametrize("want", [{"pid": 5}, {"deadzone": (1.0, 2.0, 3.0)}])
def test_what_has_another_shape_must_not_be_stored(want):
    with pytest.raises(ConfigError, match="The board must not store"):
        writes(TABLE, STORED, want)


def test_negative_gains_must_not_be_stored():
    with pytest.raises(ConfigError, match="gains P, I, D"):
        check_storable(TABLE, BoardSettings(pid=(0.8, -0.06, 0.5)))


def test_a_board_as_it_was_sold_has_no_problem():
    assert findings(STORED, PROFILES["520"]).unfit == ()


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("lines", "encoder lines"),
        ("ratio", "gear ratio"),
        ("wheel_diameter_mm", "wheel diameter"),
    ],
)
def test_a_zero_forbids_motion(name, what):
    (found,) = findings(STORED | {name: 0}, PROFILES["520"]).unfit
    assert f"stores 0 as its {what}" in found
    assert "yahboomd probe --write" in found


@pytest.mark.parametrize("stored", [2, 3, 4, 0, 9])
def test_another_motor_type_forbids_motion(stored):
    (found,) = findings(STORED | {"motor_type": stored}, PROFILES["520"]).unfit
    assert f"motor type {stored}" in found
    assert "yahboomd probe --write" in found


def test_what_the_board_did_not_show_forbids_motion():
    found = findings(BoardSettings(version="1.7.3"), PROFILES["520"]).unfit
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
            {**STORED, name: value}, radius_m=0.03, ticks_per_revolution=1320.0, scale=1.0
        )


def test_gains_of_zero_would_turn_no_wheel():
    (wrong,) = findings(STORED | {"pid": (0.0, 0.0, 0.0)}, PROFILES["520"]).wrong
    assert "--pid 0.8,0.06,0.5" in wrong
    assert findings(STORED, PROFILES["520"]).wrong == ()


def test_what_a_write_without_power_has_left_forbids_motion_and_names_the_ways_back():
    lost = STORED | {"wheel_diameter_mm": math.nan, "pid": (0.8, math.nan, 0.0)}
    (unfit,) = findings(lost, PROFILES["520"]).unfit
    (wrong,) = findings(lost, PROFILES["520"]).wrong
    assert "stores nan as its wheel diameter" in unfit
    assert "yahboomd tune --undo" in wrong
    with pytest.raises(BoardError, match="not all known"):
        units_per_m_s(lost, radius_m=0.03, ticks_per_revolution=1320.0, scale=1.0)
    assert len(writes(TABLE, lost, STORED)) == 2


def test_a_board_set_up_for_other_known_motors_names_them():
    (advice,) = findings(
        STORED | {"motor_type": 2, "lines": 13, "ratio": 20}, PROFILES["520"]
    ).advice
    assert 'board.profile = "310"' in advice


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("motor_type", 1, "1 (520)"),
        ("motor_type", 2, "2 (310)"),
        ("motor_type", 3, "3 (TT with encoder)"),
        ("motor_type", 4, "4 (TT, no encoder)"),
        ("motor_type", 9, "9 (unknown)"),
        ("ratio", 30, "30"),
        ("ratio", 20.409, "20 (truly 20.409)"),
        ("wheel_diameter_mm", 67.0, "67 mm"),
        ("pid", (0.8, 0.06, 0.5), "0.8, 0.06, 0.5"),
    ],
)
def test_values_are_shown_as_people_read_them(field, value, words):
    (row,) = [row for row in TABLE if row.field == field]
    assert row.words(value) == words
