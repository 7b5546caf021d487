from __future__ import annotations

import math
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.drive.kinematics import (
    KINEMATICS,
    ackermann,
    desaturate,
    desaturate_twist,
    differential,
    mecanum,
    motor_speeds,
    unit_geometry,
    wheel_speeds,
)
from yahboomd.core.errors import ConfigError
from yahboomd.core.model import Kinematics, Motor, Twist2d

SPEEDS = st.floats(-3.0, 3.0)
ANY = st.floats(allow_nan=True, allow_infinity=True)
ROWS = st.sampled_from(sorted(KINEMATICS)).map(
    lambda name: KINEMATICS[name](separation_m=0.17, base_m=0.21)
)


def body_twist(kinematics: Kinematics, speeds: Sequence[float]) -> Twist2d:
    """The motion of the body that these rim speeds make, without slip."""
    vx, vy, wz = (
        sum(factor * speed for factor, speed in zip(row, speeds, strict=True))
        for row in kinematics.forward
    )
    return Twist2d(vx=vx, vy=vy, wz=wz)


def test_a_positive_turn_drives_the_right_wheel_forward(two_wheels: Kinematics) -> None:
    assert wheel_speeds(two_wheels, Twist2d(wz=2.0)) == pytest.approx((-0.15, 0.15))


def test_the_articles_base_drives_straight_with_equal_wheels(two_wheels: Kinematics) -> None:
    assert wheel_speeds(two_wheels, Twist2d(vx=0.5)) == (0.5, 0.5)


def test_a_mecanum_base_slides_left_by_turning_the_diagonals_against_each_other(
    four_rollers: Kinematics,
) -> None:
    assert wheel_speeds(four_rollers, Twist2d(vy=0.4)) == pytest.approx((-0.4, 0.4, 0.4, -0.4))


def test_a_mecanum_base_turns_by_half_length_plus_half_width(four_rollers: Kinematics) -> None:
    turned = wheel_speeds(four_rollers, Twist2d(wz=1.0))
    assert turned == pytest.approx((-0.18, -0.18, 0.18, 0.18))


def test_mecanum_wheels_are_in_the_order_of_the_vendors_channels(
    four_rollers: Kinematics,
) -> None:
    assert four_rollers.wheels == ("front_left", "rear_left", "front_right", "rear_right")


def test_rollers_that_slip_are_commanded_more_to_the_side_and_believed_less() -> None:
    plain = mecanum(separation_m=0.2, base_m=0.16)
    slipping = mecanum(separation_m=0.2, base_m=0.16, sideways=0.8)
    assert wheel_speeds(slipping, Twist2d(vy=0.4)) == pytest.approx((-0.5, 0.5, 0.5, -0.5))
    for twist in (Twist2d(vx=0.4), Twist2d(wz=1.0)):
        assert wheel_speeds(slipping, twist) == wheel_speeds(plain, twist)
    assert body_twist(slipping, (-0.5, 0.5, 0.5, -0.5)).vy == pytest.approx(0.4)
    assert slipping.forward[0] + slipping.forward[2] == plain.forward[0] + plain.forward[2]
    with pytest.raises(ConfigError, match="sideways_multiplier is 0"):
        mecanum(separation_m=0.2, base_m=0.16, sideways=0.0)


def test_skid_steer_is_differential_with_the_effective_separation() -> None:
    skid = KINEMATICS["skid_steer"](separation_m=0.3)
    plain = differential(separation_m=0.3)
    assert (skid.wheels, skid.inverse, skid.forward) == (
        plain.wheels,
        plain.inverse,
        plain.forward,
    )


def test_a_turn_of_one_radian_deviates_by_a_fifth_or_a_tenth_where_wheels_slip() -> None:
    slips = {name: unit_geometry(name).turn_slip for name in KINEMATICS}
    assert slips == {"differential": 0.0, "skid_steer": 0.04, "mecanum": 0.01, "ackermann": 0.01}
    assert unit_geometry("ackermann").base_m == 1.0


@given(ROWS, SPEEDS, SPEEDS, SPEEDS)
def test_forward_of_inverse_is_the_twist(
    kinematics: Kinematics, vx: float, vy: float, wz: float
) -> None:
    twist = Twist2d(vx=vx, vy=vy if kinematics.holonomic else 0.0, wz=wz)
    back = body_twist(kinematics, wheel_speeds(kinematics, twist))
    assert (back.vx, back.vy, back.wz) == pytest.approx((twist.vx, twist.vy, twist.wz), abs=1e-12)


@given(st.lists(SPEEDS, min_size=4, max_size=4))
def test_the_mecanum_estimate_is_the_least_squares_one(speeds: list[float]) -> None:
    kinematics = mecanum(separation_m=0.2, base_m=0.16)
    explained = wheel_speeds(kinematics, body_twist(kinematics, speeds))
    residual = [a - b for a, b in zip(speeds, explained, strict=True)]
    for axis in range(3):
        column = [row[axis] for row in kinematics.inverse]
        assert sum(r * c for r, c in zip(residual, column, strict=True)) == pytest.approx(
            0.0, abs=1e-9
        )


def test_every_motor_of_a_side_has_its_speed() -> None:
    motors = [
        Motor(name=name, wheel=wheel, position=place, radius_m=0.03, ticks_per_revolution=1320.0)
        for name, wheel, place in (("a", 0, 1), ("b", 0, 2), ("c", 1, 3), ("d", 1, 4))
    ]
    assert motor_speeds(motors, (0.1, 0.2)) == (0.1, 0.1, 0.2, 0.2)


@given(
    st.lists(st.tuples(SPEEDS, st.floats(0.0, 2.0)), min_size=1, max_size=4),
)
def test_desaturation_keeps_the_ratio_of_the_wheels_and_the_limits(
    pairs: list[tuple[float, float]],
) -> None:
    speeds = [speed for speed, _ in pairs]
    limits = [limit for _, limit in pairs]
    slowed, scale = desaturate(speeds, limits)
    assert 0.0 <= scale <= 1.0
    assert slowed == pytest.approx([speed * scale for speed in speeds], abs=1e-12)
    assert all(abs(speed) <= limit for speed, limit in zip(slowed, limits, strict=True))


@given(SPEEDS, SPEEDS, st.floats(0.05, 1.0))
def test_desaturation_keeps_the_curvature(vx: float, wz: float, limit: float) -> None:
    kinematics = differential(separation_m=0.15)
    slowed, scale = desaturate(wheel_speeds(kinematics, Twist2d(vx=vx, wz=wz)), (limit, limit))
    driven = body_twist(kinematics, slowed)
    # Curvature is wz / vx; as a product, so that turning on the spot is covered too.
    assert driven.wz * vx == pytest.approx(driven.vx * wz, abs=1e-9)
    assert driven.vx == pytest.approx(vx * scale, abs=1e-9)


def test_speeds_within_the_limits_stay_as_they_are() -> None:
    assert desaturate((0.3, -0.4), (1.0, 1.0)) == ((0.3, -0.4), 1.0)


@given(st.lists(ANY, min_size=2, max_size=2))
def test_desaturated_speeds_are_finite_whatever_comes_in(speeds: list[float]) -> None:
    slowed, scale = desaturate(speeds, (1.0, 1.0))
    assert all(math.isfinite(speed) and abs(speed) <= 1.0 for speed in slowed)
    assert 0.0 <= scale <= 1.0


@given(ROWS, SPEEDS, SPEEDS, SPEEDS, st.floats(0.01, 1.0))
def test_a_desaturated_wish_is_one_that_the_wheels_can_follow(
    kinematics: Kinematics, vx: float, vy: float, wz: float, limit: float
) -> None:
    limits = (limit,) * len(kinematics.wheels)
    wish, _ = desaturate_twist(kinematics, Twist2d(vx=vx, vy=vy, wz=wz), limits)
    assert all(abs(speed) <= limit + 1e-12 for speed in wheel_speeds(kinematics, wish))


def test_a_wish_beyond_all_numbers_becomes_standstill(two_wheels: Kinematics) -> None:
    wish, scale = desaturate_twist(two_wheels, Twist2d(vx=1.7e308, wz=1.7e308 * 16), (1.0, 1.0))
    assert (wish, scale) == (Twist2d(), 0.0)


@pytest.mark.parametrize("separation_m", [0.0, -0.1, math.nan, math.inf])
@pytest.mark.parametrize("name", sorted(KINEMATICS))
def test_a_separation_that_is_no_distance_is_refused(name: str, separation_m: float) -> None:
    with pytest.raises(ConfigError, match="wheel_separation_m"):
        KINEMATICS[name](separation_m=separation_m, base_m=0.2)


def test_mecanum_without_a_wheel_base_is_refused() -> None:
    with pytest.raises(ConfigError, match="wheel_base_m"):
        mecanum(separation_m=0.2)


@pytest.mark.parametrize(("vx", "scale"), [(0.5, 1.0), (1.0, 1.0), (2.0, 0.5)])
def test_a_wish_is_scaled_by_as_much_as_its_fastest_wheel_needs(
    two_wheels: Kinematics, vx: float, scale: float
) -> None:
    slowed = desaturate_twist(two_wheels, Twist2d(vx=vx), (1.0, 1.5))
    assert slowed == (Twist2d(vx=vx * scale), scale)


def test_a_car_turns_its_rear_wheels_like_two_sides_and_has_a_tightest_curve() -> None:
    car = ackermann(separation_m=0.2, base_m=0.25, steering_max_rad=math.pi / 4.0)
    two = differential(separation_m=0.2)
    assert (car.inverse, car.forward, car.wheels) == (two.inverse, two.forward, two.wheels)
    assert (car.name, car.base_m) == ("ackermann", 0.25)
    assert car.least_radius_m == pytest.approx(0.25)
    assert two.least_radius_m == 0.0
    for angle_rad in (0.4, 1.5):
        car = ackermann(separation_m=0.2, base_m=0.25, steering_max_rad=angle_rad)
        assert car.least_radius_m == pytest.approx(0.25 / math.tan(angle_rad))


@pytest.mark.parametrize(
    "given", [{}, {"base_m": 0.0}, {"base_m": 0.2, "steering_max_rad": math.pi / 2.0}]
)
def test_a_car_without_axles_or_angle_is_refused(given: dict[str, float]) -> None:
    with pytest.raises(ConfigError):
        ackermann(separation_m=0.2, **given)
