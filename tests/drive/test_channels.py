from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.drive.channels import (
    MOTOR_PRESETS,
    Placement,
    build_motors,
    channel_commands,
    motor_speeds,
    wheel_limits,
)
from yahboomd.drive.kinematics import differential, mecanum, skid_steer
from yahboomd.errors import ConfigError
from yahboomd.model import Kinematics, Motor


def skid_motors() -> tuple[Motor, ...]:
    return build_motors(
        skid_steer(separation_m=0.3),
        MOTOR_PRESETS["vendor_4wd"],
        radius_m=0.0335,
        ticks_per_revolution=1320.0,
    )


def test_the_articles_wheels_are_at_a_and_c(article_motors: tuple[Motor, ...]) -> None:
    assert channel_commands(article_motors, (0.5, 0.25), (1000.0, 1000.0)) == (500, 0, 250, 0)


def test_both_motors_of_a_skid_steer_side_get_its_speed() -> None:
    assert channel_commands(skid_motors(), (0.1, 0.2), (1000.0,) * 4) == (100, 100, 200, 200)
    assert motor_speeds(skid_motors(), (0.1, 0.2)) == (0.1, 0.1, 0.2, 0.2)


def test_skid_steer_motors_are_named_by_side_front_first() -> None:
    names = [motor.name for motor in skid_motors()]
    assert names == ["front_left", "rear_left", "front_right", "rear_right"]


def test_mecanum_wheels_are_the_vendors_m1_to_m4() -> None:
    kinematics = mecanum(separation_m=0.2, base_m=0.16)
    motors = build_motors(
        kinematics, MOTOR_PRESETS["mecanum"], radius_m=0.04, ticks_per_revolution=1320.0
    )
    assert [(motor.name, motor.position) for motor in motors] == list(
        zip(kinematics.wheels, (1, 2, 3, 4), strict=True)
    )


def test_a_motor_mounted_the_other_way_gets_the_opposite_command(two_wheels: Kinematics) -> None:
    motors = build_motors(
        two_wheels,
        {"left": [Placement(position=4)], "right": [Placement(position=2, command_sign=-1)]},
        radius_m=0.0325,
        ticks_per_revolution=1320.0,
    )
    assert channel_commands(motors, (0.5, 0.25), (1000.0, 1000.0)) == (0, -250, 0, 500)


def test_each_motor_has_its_own_units(article_motors: tuple[Motor, ...]) -> None:
    assert channel_commands(article_motors, (0.5, 0.5), (1000.0, 1010.0)) == (500, 0, 505, 0)


@given(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_commands_are_the_nearest_whole_units_and_unused_positions_are_zero(
    left: float, right: float
) -> None:
    motors = build_motors(
        differential(separation_m=0.15),
        MOTOR_PRESETS["article_2wd"],
        radius_m=0.0325,
        ticks_per_revolution=1320.0,
    )
    commands = channel_commands(motors, (left, right), (1000.0, 1000.0))
    assert all(isinstance(command, int) for command in commands)
    assert abs(commands[0] - left * 1000.0) <= 0.5
    assert abs(commands[2] - right * 1000.0) <= 0.5
    assert (commands[1], commands[3]) == (0, 0)


@pytest.mark.parametrize("speed", [math.nan, math.inf, -math.inf, 1.7e308])
def test_a_command_that_is_no_finite_number_is_refused(
    article_motors: tuple[Motor, ...], speed: float
) -> None:
    with pytest.raises(ValueError, match="right"):
        channel_commands(article_motors, (0.0, speed), (1000.0, 1000.0))


def test_a_wheel_is_as_fast_as_the_slowest_of_its_motors() -> None:
    kinematics = skid_steer(separation_m=0.3)
    limits = wheel_limits(kinematics, skid_motors(), (1000.0, 1250.0, 1000.0, 1000.0), 1000)
    assert limits == pytest.approx((0.8, 1.0))


def test_calibration_reaches_the_radius_by_wheel_or_by_side() -> None:
    motors = build_motors(
        mecanum(separation_m=0.2, base_m=0.16),
        MOTOR_PRESETS["mecanum"],
        radius_m=0.04,
        ticks_per_revolution=1320.0,
        radius_multipliers={"left": 1.01, "front_right": 0.99},
    )
    assert [motor.radius_m for motor in motors] == pytest.approx([0.0404, 0.0404, 0.0396, 0.04])


def test_all_mistakes_of_a_wiring_are_named_at_once(two_wheels: Kinematics) -> None:
    with pytest.raises(ConfigError) as caught:
        build_motors(
            two_wheels,
            {
                "left": [Placement(position=1), Placement(position=1), Placement(position=5)],
                "middle": [Placement(position=2, encoder_sign=0)],
            },
            radius_m=-1.0,
            ticks_per_revolution=0.0,
        )
    message = str(caught.value)
    for mistake in (
        "middle: a differential base has no such wheel",
        "right: no motor turns this wheel",
        "position 1 already is left's",
        "position 5 is not on the board",
        "encoder_sign is 0",
        "ticks_per_revolution is 0.0",
        "radius of left",
    ):
        assert mistake in message
