"""A car drives the curve that it was asked for, or the tightest that it can."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.drive.curve import Curve
from yahboomd.core.drive.kinematics import ackermann, differential
from yahboomd.core.drive.limiter import AxisCaps, Limiter
from yahboomd.core.model import STANDSTILL, Twist2d

R2 = ackermann(separation_m=0.1911, base_m=0.23537, steering_max_rad=math.pi / 4.0)
RADIUS_M = 0.23537

speeds = st.floats(-10.0, 10.0)


def curve(linear: float | None = 1.0, angular: float | None = 6.0) -> Curve:
    return Curve(R2, linear, angular)


def test_a_wish_that_can_be_done_is_done() -> None:
    wish = Twist2d(vx=0.5, wz=1.0)
    assert curve().steer(wish) == (Twist2d(vx=0.5, wz=pytest.approx(1.0)), False)


@pytest.mark.parametrize(("vx", "wz"), [(0.2, 3.0), (0.2, -3.0), (-0.2, 3.0), (-0.2, -3.0)])
def test_one_that_is_too_tight_becomes_the_tightest_at_its_speed(vx: float, wz: float) -> None:
    twist, too_tight = curve().steer(Twist2d(vx=vx, wz=wz))
    assert too_tight
    assert twist.vx == vx
    assert twist.wz == pytest.approx(math.copysign(0.2 / RADIUS_M, wz))


def test_a_turn_on_the_spot_is_standstill_and_too_tight() -> None:
    assert curve().steer(Twist2d(wz=1.0)) == (STANDSTILL, True)
    assert curve().steer(STANDSTILL) == (STANDSTILL, False)


def test_the_tightest_curve_itself_is_not_too_tight() -> None:
    for vx in (0.1, 0.3, 0.7):
        assert not curve().steer(Twist2d(vx=vx, wz=vx / RADIUS_M))[1]
        assert curve().steer(Twist2d(vx=vx, wz=1.001 * vx / RADIUS_M))[1]


@given(speeds, speeds)
def test_what_comes_out_can_be_steered_and_is_never_faster_than_the_wish(
    vx: float, wz: float
) -> None:
    wish = Twist2d(vx=vx, wz=wz)
    twist, too_tight = curve().steer(wish)
    assert abs(twist.wz) * RADIUS_M <= abs(twist.vx) * (1.0 + 1e-9)
    assert abs(twist.vx) <= min(1.0, abs(vx))
    assert abs(twist.wz) <= min(6.0, abs(wz)) * (1.0 + 1e-9)
    assert twist.vx * vx >= 0.0
    assert twist.wz * wz >= 0.0
    if not too_tight:
        # Scaled along its curve.
        assert twist.vx * wz == pytest.approx(twist.wz * vx, abs=1e-9)


def test_a_wish_beyond_the_limits_is_slower_along_the_same_curve() -> None:
    twist, too_tight = curve(linear=0.5).steer(Twist2d(vx=2.0, wz=4.0))
    assert (twist, too_tight) == (Twist2d(vx=0.5, wz=1.0), False)
    twist, _ = curve(linear=None, angular=1.0).steer(Twist2d(vx=2.0, wz=4.0))
    assert twist == Twist2d(vx=0.5, wz=1.0)
    assert curve(None, None).steer(Twist2d(vx=9.0, wz=9.0))[0] == Twist2d(vx=9.0, wz=9.0)


def test_ramps_keep_the_curve_from_standstill_to_standstill() -> None:
    limiter = Limiter(AxisCaps(acceleration=1.0, deceleration=2.0), AxisCaps(acceleration=9.0))
    made = curve()
    for wish in [Twist2d(vx=0.5, wz=1.0)] * 40 + [STANDSTILL] * 40:
        twist = made.ramped(limiter.limit(made.steer(wish)[0], 0.02))
        assert twist.wz == pytest.approx(2.0 * twist.vx)
    assert twist == STANDSTILL


def test_a_base_that_does_not_steer_gets_its_wish() -> None:
    made = Curve(differential(separation_m=0.15), 0.1, 0.1)
    wish = Twist2d(vx=0.5, wz=9.0)
    assert made.steer(wish) == (wish, False)
    assert made.ramped(Twist2d(wz=3.0)) == Twist2d(wz=3.0)
