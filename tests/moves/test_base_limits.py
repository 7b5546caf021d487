"""The limits of a move: the configured ones, or lower ones."""

from __future__ import annotations

import math

import pytest

from yahboomd.client.move_messages import Move
from yahboomd.core.config import read
from yahboomd.core.model import Pose2d
from yahboomd.moves.motion.base_limits import base_of, turn_limits, way_limits
from yahboomd.moves.motion.move_plan import MoveRefused, plan


def config(*overrides: str) -> dict:
    return read(None, environ={}, overrides=list(overrides)).config.resolved().as_data()


def test_a_move_has_gentle_limits_unless_it_names_others() -> None:
    base = base_of(config())
    plain = way_limits(Move(kind="straight"), base)
    assert (plain.speed, plain.acceleration, plain.jerk) == (0.3, 0.6, 4.0)
    fast = way_limits(Move(kind="straight", speed_m_s=0.8, acceleration_m_s2=1.5), base)
    assert (fast.speed, fast.acceleration) == (0.8, 1.5)
    assert turn_limits(Move(kind="turn", turn_rad_s=3.0), base).speed == 3.0


def test_no_move_exceeds_what_is_configured() -> None:
    base = base_of(
        config(
            "limits.linear.velocity=0.2", "limits.linear.acceleration=0.5", "limits.linear.jerk=2"
        )
    )
    limits = way_limits(
        Move(kind="straight", speed_m_s=5.0, acceleration_m_s2=9.0, jerk_m_s3=100.0), base
    )
    assert (limits.speed, limits.acceleration, limits.jerk) == (0.2, 0.5, 2.0)
    assert turn_limits(Move(kind="turn", turn_rad_s=50.0), base).speed == 6.0


def test_the_deceleration_limits_both_ramps() -> None:
    base = base_of(config("limits.linear.deceleration=0.4"))
    limits = way_limits(Move(kind="straight"), base)
    assert limits.acceleration == limits.braking == 0.4


@pytest.mark.parametrize("preset", ["2wd", "4wd"])
def test_bases_with_two_sides_turn_in_place(preset: str) -> None:
    base = base_of(config(f"chassis.preset={preset}"))
    assert base.turns
    assert not base.holonomic


def test_mecanum_moves_sideways() -> None:
    assert base_of(config("chassis.preset=mecanum", "chassis.wheel_base_m=0.13")).holonomic


def test_a_car_has_its_tightest_curve() -> None:
    wheels = ("chassis.preset=ackermann", "chassis.wheel_base_m=0.2")
    assert base_of(config(*wheels)).least_radius_m == pytest.approx(0.2)
    base = base_of(config(*wheels, "chassis.steering_max_rad=0.5"))
    assert base.least_radius_m == pytest.approx(0.2 / math.tan(0.5))
    assert not base.turns


def test_a_move_whose_speed_does_not_start_the_robot_is_refused_before_it_begins() -> None:
    known = ("chassis.break_away_linear_m_s=0.12", "chassis.break_away_angular_rad_s=0.35")
    base = base_of(config(*known))
    slow = Move(kind="turn", angle_rad=1.0, turn_rad_s=0.3)
    with pytest.raises(MoveRefused, match=r"does not begin to turn below 0\.35 rad/s.*turn_rad_s"):
        plan([slow], Pose2d(), base)
    with pytest.raises(MoveRefused, match=r"does not begin to drive below 0\.12 m/s"):
        plan([Move(kind="straight", distance_m=1.0, speed_m_s=0.1)], Pose2d(), base)
    assert plan([Move(kind="turn", angle_rad=1.0, speed_m_s=0.1)], Pose2d(), base)
    assert plan([slow], Pose2d(), base_of(config()))
