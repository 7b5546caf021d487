from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.model import Kinematics, Motor
from yahboomd.core.protocol.per_motor import PerMotor, per_motor

TWO_SIDES = Kinematics(
    name="differential",
    wheels=("left", "right"),
    inverse=((1.0, 0.0, -0.1), (1.0, 0.0, 0.1)),
    forward=((0.5, 0.5), (0.0, 0.0), (-5.0, 5.0)),
)


def motion(*places: tuple[int, int], units: tuple[float, ...] = (1000.0,) * 4) -> PerMotor:
    """Motors at (position, sign), the first half of them on the left."""
    motors = tuple(
        Motor(
            name=f"{'left' if index < len(places) / 2 else 'right'}_{index}",
            wheel=0 if index < len(places) / 2 else 1,
            position=position,
            command_sign=sign,
            radius_m=0.0335,
            ticks_per_revolution=1320.0,
        )
        for index, (position, sign) in enumerate(places)
    )
    return per_motor(TWO_SIDES, motors, units[: len(motors)], 1000)


ARTICLE = motion((1, 1), (3, 1))


def test_each_wheel_is_commanded_at_its_motors_position() -> None:
    assert ARTICLE.units((0.5, 0.25)) == (500, 0, 250, 0)


def test_every_motor_of_a_side_gets_its_speed() -> None:
    four = motion((1, 1), (2, 1), (3, 1), (4, 1))
    assert four.units((0.1, 0.2)) == (100, 100, 200, 200)


def test_a_motor_mounted_the_other_way_gets_the_opposite_command() -> None:
    assert motion((4, 1), (2, -1)).units((0.5, 0.25)) == (0, -250, 0, 500)


def test_each_motor_has_its_own_units() -> None:
    assert motion((1, 1), (3, 1), units=(1000.0, 1010.0)).units((0.5, 0.5)) == (500, 0, 505, 0)


@given(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_commands_are_the_nearest_whole_units_and_unused_positions_are_zero(
    left: float, right: float
) -> None:
    commands = ARTICLE.units((left, right))
    assert all(isinstance(command, int) for command in commands)
    assert abs(commands[0] - left * 1000.0) <= 0.5
    assert abs(commands[2] - right * 1000.0) <= 0.5
    assert (commands[1], commands[3]) == (0, 0)


@pytest.mark.parametrize("speed", [math.nan, math.inf, -math.inf, 1.7e308])
def test_a_command_that_is_no_finite_number_is_refused(speed: float) -> None:
    with pytest.raises(ValueError, match="right"):
        ARTICLE.units((0.0, speed))


def test_a_wheel_is_as_fast_as_the_slowest_of_its_motors() -> None:
    four = motion((1, 1), (2, 1), (3, 1), (4, 1), units=(1000.0, 1250.0, 1000.0, 1000.0))
    assert four.wheel_limits == pytest.approx((0.8, 1.0))
