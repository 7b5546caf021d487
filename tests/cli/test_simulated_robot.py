"""The simulated robot is built from the configuration."""

from __future__ import annotations

import pytest

from yahboomd.core.config import Config
from yahboomd.simulation.options import FOUR_WHEELS, TWO_WHEELS, check
from yahboomd.tools.robot.simulated_robot import as_configured


def test_the_default_configuration_is_the_usual_robot() -> None:
    robot = as_configured(Config())
    assert (robot.drive, robot.motors, robot.dialect) == ("differential", TWO_WHEELS, "streamed")
    assert (robot.wheel_separation_m, robot.wheel_radius_m) == (0.15, 0.0335)


@pytest.mark.parametrize(("preset", "drive"), [("4wd", "skid_steer"), ("mecanum", "mecanum")])
def test_a_preset_has_four_motors_where_the_vendor_has_them(preset: str, drive: str) -> None:
    chassis = {"preset": preset} | ({"wheel_base_m": 0.17} if preset == "mecanum" else {})
    robot = as_configured(Config.model_validate({"chassis": chassis}))
    check(robot)
    assert robot.drive == drive
    named = {(wire.name, wire.position) for wire in robot.motors}
    assert named == {(wire.name, wire.position) for wire in FOUR_WHEELS}


def test_motors_profile_and_track_are_those_of_the_configuration() -> None:
    config = Config.model_validate(
        {
            "board": {"profile": "310"},
            "serial": {"dialect": "polled"},
            "chassis": {
                "wheel_separation_m": 0.2,
                "wheel_separation_multiplier": 1.5,
                "wheel_radius_multiplier": {"left": 1.1},
                "motors": {
                    "left": [{"position": 4, "command_sign": -1, "encoder_sign": -1}],
                    "right": [{"position": 2}],
                },
            },
        }
    )
    robot = as_configured(config)
    check(robot)
    left, right = robot.motors
    assert (left.position, left.command_sign, left.encoder_sign) == (4, -1, -1)
    assert (right.position, right.command_sign, right.encoder_sign) == (2, 1, 1)
    assert left.radius_scale == pytest.approx(1.1)
    assert robot.wheel_separation_m == pytest.approx(0.3)
    assert robot.ticks_per_revolution == pytest.approx(config.ticks_per_revolution())
    assert (robot.dialect, robot.flash) == ("polled", None)


def test_a_car_that_steers_has_its_rear_wheels_and_its_boards_type() -> None:
    sections = {
        "serial": {"dialect": "rosmaster"},
        "board": {"profile": "r2"},
        "chassis": {"preset": "ackermann", "wheel_base_m": 0.235, "wheel_separation_m": 0.191},
    }
    robot = as_configured(Config.model_validate(sections))
    assert [(wire.corner, wire.position) for wire in robot.motors] == [("left", 2), ("right", 4)]
    assert (robot.drive, robot.flash.car_type) == ("ackermann", 5)  # type: ignore[union-attr]
    assert robot.ticks_per_revolution == 836
    assert robot.wheel_base_m == 0.235
