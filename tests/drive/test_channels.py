from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.drive.channels import channel_commands, motor_speeds, wheel_limits
from yahboomd.drive.kinematics import skid_steer
from yahboomd.model import Motor


def motor(wheel: int, position: int, command_sign: int = 1) -> Motor:
    return Motor(
        name=f"M{position}",
        wheel=wheel,
        position=position,
        command_sign=command_sign,
        radius_m=0.0335,
        ticks_per_revolution=1320.0,
    )


SKID_MOTORS = (motor(0, 1), motor(0, 2), motor(1, 3), motor(1, 4))


def test_the_articles_wheels_are_at_a_and_c(article_motors: tuple[Motor, ...]) -> None:
    assert channel_commands(article_motors, (0.5, 0.25), (1000.0, 1000.0)) == (500, 0, 250, 0)


def test_both_motors_of_a_skid_steer_side_get_its_speed() -> None:
    assert channel_commands(SKID_MOTORS, (0.1, 0.2), (1000.0,) * 4) == (100, 100, 200, 200)
    assert motor_speeds(SKID_MOTORS, (0.1, 0.2)) == (0.1, 0.1, 0.2, 0.2)


def test_a_motor_mounted_the_other_way_gets_the_opposite_command() -> None:
    motors = (motor(0, 4), motor(1, 2, command_sign=-1))
    assert channel_commands(motors, (0.5, 0.25), (1000.0, 1000.0)) == (0, -250, 0, 500)


def test_each_motor_has_its_own_units(article_motors: tuple[Motor, ...]) -> None:
    assert channel_commands(article_motors, (0.5, 0.5), (1000.0, 1010.0)) == (500, 0, 505, 0)


@given(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_commands_are_the_nearest_whole_units_and_unused_positions_are_zero(
    left: float, right: float
) -> None:
    commands = channel_commands((motor(0, 1), motor(1, 3)), (left, right), (1000.0, 1000.0))
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
    limits = wheel_limits(kinematics, SKID_MOTORS, (1000.0, 1250.0, 1000.0, 1000.0), 1000)
    assert limits == pytest.approx((0.8, 1.0))
