from __future__ import annotations

import pytest
from pydantic import ValidationError

from yahboomd.core.config.hardware import PRESETS, Board, Chassis, MotorEntry, Serial, preset_motors
from yahboomd.core.drive.kinematics import unit_geometry
from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.core.protocol.registry import DIALECTS


def test_the_defaults_are_the_articles_robot():
    chassis = Chassis()
    assert chassis.wheel_separation_m == 0.150
    assert chassis.kinematics == "differential"
    assert {wheel: motors[0].position for wheel, motors in chassis.motors.items()} == {
        "left": 1,
        "right": 3,
    }
    assert (Serial().baudrate, Serial().dtr, Serial().rts) == (115200, True, False)
    assert not Board().write_settings


def test_a_battery_is_described_by_a_rising_curve():
    assert Board().battery_curve == ()
    curve = ((9.6, 0.0), (11.1, 0.4), (12.6, 1.0))
    assert (
        Board.model_validate({"battery_curve": [list(point) for point in curve]}).battery_curve
        == curve
    )


@pytest.mark.parametrize(
    ("curve", "why"),
    [
        ([[9.6, 0.0]], "one point is no curve"),
        ([[9.6, 0.0], [9.6, 1.0]], "rise from point to point"),
        ([[12.6, 0.0], [9.6, 1.0]], "rise from point to point"),
        ([[9.6, 1.0], [12.6, 0.0]], "does not fall"),
        ([[9.6, 0.0], [12.6, 100.0]], "from 0 to 1"),
        ([[9.6, 0.0, 1.0], [12.6, 1.0]], "at most 2"),
        ([9.6, 12.6], "battery_curve.0"),
        ([[9.6, float("nan")], [12.6, 1.0]], "finite"),
    ],
)
def test_what_is_no_curve_of_a_battery_is_refused(curve, why):
    with pytest.raises(ValidationError, match=why):
        Board.model_validate({"battery_curve": curve})


@pytest.mark.parametrize("profile", [*PROFILES, "custom"])
def test_every_profile_of_the_protocol_can_be_chosen(profile):
    assert Board.model_validate({"profile": profile}).profile == profile


@pytest.mark.parametrize("dialect", ["auto", *DIALECTS])
def test_every_dialect_of_the_registry_can_be_chosen(dialect):
    assert Serial.model_validate({"dialect": dialect}).dialect == dialect


def test_a_dialect_that_is_registered_at_run_time_can_be_named_and_then_not_any_more(monkeypatch):
    monkeypatch.setitem(DIALECTS, "later", DIALECTS["polled"])
    assert Serial.model_validate({"dialect": "later"}).dialect == "later"
    monkeypatch.delitem(DIALECTS, "later")
    with pytest.raises(ValidationError):
        Serial.model_validate({"dialect": "later"})


@pytest.mark.parametrize("preset", PRESETS)
def test_a_preset_gives_every_wheel_motors_of_its_own(preset):
    kinematics, motors = PRESETS[preset]
    positions = [entry.position for entries in motors.values() for entry in entries]
    assert set(motors) == set(unit_geometry(kinematics).wheels)
    assert len(set(positions)) == len(positions)


def test_every_preset_of_the_table_is_a_word_of_the_configuration():
    for preset in PRESETS:
        assert Chassis.model_validate({"preset": preset}).preset == preset


@pytest.mark.parametrize(
    "values",
    [
        {"wheel_separation_m": 0.0},
        {"wheel_separation_m": -0.1},
        {"wheel_separation_m": 150},
        {"wheel_separation_m": float("nan")},
        {"wheel_separation_m": "0.15"},
        {"wheel_radius_m": 0},
        {"wheel_radius_m": 32.5},
        {"ticks_per_revolution": 0},
        {"ticks_per_revolution": 1e9},
        {"wheel_radius_multiplier": {"left": 0.0}},
        {"motors": {"left": []}},
        {"kinematics": "hover"},
    ],
)
def test_impossible_geometry_is_refused(values):
    with pytest.raises(ValidationError):
        Chassis.model_validate(values)


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"position": 0},
        {"position": 5},
        {"position": 1, "command_sign": 0},
        {"position": 1, "encoder_sign": 2},
        {"position": 1, "encoder_sign": True},
        {"position": 1, "name": "front left"},
    ],
)
def test_a_motor_that_the_board_has_not_is_refused(values):
    with pytest.raises(ValidationError):
        MotorEntry.model_validate(values)


def test_whole_numbers_will_do_where_numbers_are_expected():
    assert Chassis.model_validate({"wheel_separation_m": 1}).wheel_separation_m == 1.0


def test_a_configuration_does_not_change():
    with pytest.raises(ValidationError):
        Board().profile = "310"  # type: ignore[misc]


@pytest.mark.parametrize(
    "chassis",
    [
        {"preset": "4wd", "motors": {"right": [{"position": 4, "command_sign": -1}]}},
        # From --set, the default of the whole table comes along.
        {
            "preset": "4wd",
            "motors": {
                "left": [{"position": 1}],
                "right": [{"position": 4, "command_sign": -1}],
            },
        },
    ],
)
def test_a_motor_mounted_the_other_way_round_stands_beside_a_preset(chassis):
    motors = preset_motors(Chassis.model_validate(chassis))
    assert motors["left"] == PRESETS["4wd"][1]["left"]
    assert [(entry.position, entry.name) for entry in motors["right"]] == [
        (3, "front_right"),
        (4, "rear_right"),
    ]
    assert [entry.command_sign for entry in motors["right"]] == [1, -1]


def test_a_motor_beside_a_preset_may_have_a_name_of_its_own():
    motors = {"right": [{"position": 4, "name": "back_right"}]}
    chassis = Chassis.model_validate({"preset": "4wd", "motors": motors})
    assert preset_motors(chassis)["right"][1].name == "back_right"


@pytest.mark.parametrize(("section", "name"), [(Serial, "port"), (Chassis, "calibration_file")])
def test_a_path_with_a_byte_that_no_path_has_is_a_mistake(section, name):
    assert getattr(section.model_validate({name: "/dev/x y"}), name) == "/dev/x y"
    with pytest.raises(ValidationError, match="a path has no byte 0"):
        section.model_validate({name: "/dev/\0x"})


@pytest.mark.parametrize(
    ("board", "low_v"),
    [
        ({}, None),
        ({"battery_low_v": 7.0}, 7.0),
        ({"battery_curve": [[9.0, 0.0], [11.0, 0.2], [12.6, 1.0]]}, 10.0),
        ({"battery_curve": [[9.0, 0.3], [12.6, 1.0]]}, 9.0),
        ({"battery_curve": [[9.0, 0.0], [12.6, 1.0]], "battery_low_v": 0.0}, None),
    ],
)
def test_a_battery_is_low_at_10_percent_of_its_curve_or_where_a_person_says(board, low_v):
    assert Board.model_validate(board).low_v() == low_v
