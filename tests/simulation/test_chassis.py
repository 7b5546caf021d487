from __future__ import annotations

import math
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.simulation.chassis import ChassisTruth, shares
from yahboomd.simulation.options import (
    FOUR_WHEELS,
    REAR_WHEELS,
    TWO_WHEELS,
    WIRINGS,
    DriveName,
    Wiring,
)

TRACK_M = 0.15
BASE_M = 0.17
ARM_M = (TRACK_M + BASE_M) / 2


def chassis(
    drive: DriveName = "differential", wiring: tuple[Wiring, ...] = TWO_WHEELS
) -> ChassisTruth:
    return ChassisTruth(shares(drive, wiring, wheel_separation_m=TRACK_M, wheel_base_m=BASE_M))


def test_equal_wheels_go_straight() -> None:
    base = chassis()
    base.advance([1.0, 1.0])
    assert (base.pose.x, base.pose.y, base.pose.theta) == (1.0, 0.0, 0.0)


def test_a_faster_right_wheel_turns_left() -> None:
    twist = chassis().twist([0.4, 0.6])
    assert twist.vx == pytest.approx(0.5)
    assert twist.wz == pytest.approx(0.2 / TRACK_M)


def test_any_number_of_steps_around_a_circle_comes_back() -> None:
    radius_m = 0.5
    inner, outer = (radius_m - TRACK_M / 2) * math.tau, (radius_m + TRACK_M / 2) * math.tau
    for steps in (1, 3, 1000):
        base = chassis()
        for _ in range(steps):
            base.advance([inner / steps, outer / steps])
        assert math.hypot(base.pose.x, base.pose.y) < 1e-12
        assert base.pose.theta == pytest.approx(math.tau)


def test_a_quarter_of_a_circle_in_one_step_is_exact() -> None:
    base = chassis()
    base.advance([(1.0 - TRACK_M / 2) * math.pi / 2, (1.0 + TRACK_M / 2) * math.pi / 2])
    assert base.pose.x == pytest.approx(1.0, abs=1e-15)
    assert base.pose.y == pytest.approx(1.0, abs=1e-15)


@given(st.floats(-3e-4, 3e-4))
def test_the_arc_has_no_step_where_its_series_begins(turn: float) -> None:
    base = chassis()
    base.advance([1.0 - turn * TRACK_M / 2, 1.0 + turn * TRACK_M / 2])
    half = turn / 2
    chord = math.sin(half) / half if half else 1.0
    assert base.pose.x == pytest.approx(chord * math.cos(half), rel=1e-14)


def test_a_side_of_several_wheels_moves_as_their_mean() -> None:
    base = chassis("skid_steer", FOUR_WHEELS)
    twist = base.twist([0.1, 0.3, 0.6, 0.6])
    assert twist.vx == pytest.approx(0.4)
    assert twist.wz == pytest.approx(0.4 / TRACK_M)


@given(*(st.floats(-1, 1) for _ in range(3)))
def test_mecanum_wheels_give_back_the_motion_that_they_were_made_from(
    vx: float, vy: float, wz: float
) -> None:
    turn = ARM_M * wz
    speeds = [vx - vy - turn, vx + vy - turn, vx + vy + turn, vx - vy + turn]
    twist = chassis("mecanum", FOUR_WHEELS).twist(speeds)
    assert (twist.vx, twist.vy, twist.wz) == pytest.approx((vx, vy, wz), abs=1e-12)


def test_mecanum_moves_sideways() -> None:
    base = chassis("mecanum", FOUR_WHEELS)
    base.advance([-1.0, 1.0, 1.0, -1.0])
    assert (base.pose.x, base.pose.y) == pytest.approx((0.0, 1.0))


def test_steered_front_wheels_force_their_curve_whatever_the_rear_ones_do() -> None:
    base = chassis("ackermann", REAR_WHEELS)
    assert base.twist([0.4, 0.6]).wz == pytest.approx(0.2 / TRACK_M)
    base.turn_per_m = math.tan(math.radians(30.0)) / BASE_M
    for speeds in ([0.4, 0.6], [0.5, 0.5], [-0.5, -0.5]):
        twist = base.twist(speeds)
        radius_m = BASE_M / math.tan(math.radians(30.0))
        assert twist.wz == pytest.approx(twist.vx / radius_m)
    assert base.twist([-0.2, 0.2]).wz == 0.0


@pytest.mark.parametrize("drive", get_args(DriveName))
def test_every_drive_has_usual_motors_and_shares_that_go_ahead_and_turn(drive: DriveName) -> None:
    ahead, left, turn = (
        sum(axis) for axis in zip(*chassis(drive, WIRINGS[drive])._parts, strict=True)
    )
    assert (ahead, left, turn) == pytest.approx((1.0, 0.0, 0.0), abs=1e-12)
    sides = [-1.0 if "left" in wire.corner else 1.0 for wire in WIRINGS[drive]]
    assert chassis(drive, WIRINGS[drive]).twist(sides).wz > 0.0


def test_rollers_that_slip_go_less_far_to_the_side_alone() -> None:
    parts = shares("mecanum", FOUR_WHEELS, wheel_separation_m=0.2, wheel_base_m=0.2, sideways=0.8)
    base = ChassisTruth(parts)
    assert base.body([-1.0, 1.0, 1.0, -1.0]) == pytest.approx((0.0, 0.8, 0.0))
    assert base.body([1.0, 1.0, 1.0, 1.0]) == pytest.approx((1.0, 0.0, 0.0))
    assert base.body([-1.0, -1.0, 1.0, 1.0]) == pytest.approx((0.0, 0.0, 5.0))


def test_rollers_that_are_mounted_mirrored_go_to_the_other_side_and_turn_nothing() -> None:
    parts = shares("mecanum", FOUR_WHEELS, wheel_separation_m=0.2, wheel_base_m=0.2, sideways=-0.8)
    base = ChassisTruth(parts)
    assert base.body([-1.0, 1.0, 1.0, -1.0]) == pytest.approx((0.0, -0.8, 0.0))
    assert base.body([1.0, 1.0, 1.0, 1.0]) == pytest.approx((1.0, 0.0, 0.0))
    assert base.body([-1.0, -1.0, 1.0, 1.0]) == pytest.approx((0.0, 0.0, 0.0))
