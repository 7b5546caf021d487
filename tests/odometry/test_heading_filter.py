"""The filter's result for wheels and gyro, in cases with a known answer."""

from __future__ import annotations

import math
from random import Random

import numpy as np
import pytest

from yahboomd.core.odometry.heading_filter import BIAS_RAD_S, LATE_S, HeadingFilter

DT_S = 0.04
NOISE = (1e-3 * DT_S) ** 2
UNSURE = 1e-7


def fuse(
    made: HeadingFilter, wheels: float, gyro: float, *, slip: float = 0.0, rate: float = 0.0
) -> None:
    made.fuse(wheels, gyro, DT_S, rate=rate, slip=slip, noise=NOISE, unsure=UNSURE)


def at_rest(bias: float, seconds: float, random: Random) -> HeadingFilter:
    made = HeadingFilter()
    for _ in range(round(seconds / DT_S)):
        fuse(made, 0.0, DT_S * random.gauss(bias, 1e-3))
    return made


@pytest.mark.parametrize("bias", [0.0, 0.02, -0.085])
def test_at_rest_the_bias_is_learned_and_the_heading_stays(bias: float) -> None:
    made = at_rest(bias, 5.0, Random(1))
    assert made.bias == pytest.approx(bias, abs=4.0 * math.sqrt(made.bias_variance))
    assert math.sqrt(made.bias_variance) < 5e-4
    assert made.error == 0.0


def test_the_bias_converges_with_time_at_rest() -> None:
    errors = {
        seconds: [at_rest(0.03, seconds, Random(seed)).bias - 0.03 for seed in range(30)]
        for seconds in (0.4, 2.0, 10.0)
    }
    spread = [math.sqrt(sum(e * e for e in each) / 30.0) for each in errors.values()]
    assert BIAS_RAD_S / 20.0 > spread[0] > 1.5 * spread[1] > 1.5 * spread[2]
    assert spread[2] < 4e-4


def test_before_the_bias_is_known_the_heading_is_the_wheels() -> None:
    made = HeadingFilter()
    for _ in range(25):
        fuse(made, 0.04, 0.04 + 0.08 * DT_S, slip=1e-6)
    assert made.error == pytest.approx(0.0, abs=5e-3)


def test_where_wheels_slip_the_turn_is_the_gyros_less_its_bias() -> None:
    made = at_rest(0.03, 10.0, Random(2))
    for _ in range(50):
        fuse(made, 0.05, 0.04 + 0.03 * DT_S, slip=0.04 * 0.05)
    assert made.error == pytest.approx(0.5, abs=2e-3)
    assert not made.slipped


def test_wheels_that_are_sure_keep_the_heading_to_the_tick() -> None:
    made = at_rest(0.0, 10.0, Random(3))
    random = Random(4)
    for _ in range(500):
        fuse(made, 0.02, DT_S * random.gauss(0.5, 1e-3), slip=1e-12)
    assert made.error == pytest.approx(0.0, abs=1e-4)


def test_a_slip_that_was_not_expected_is_noticed_and_taken_over() -> None:
    made = at_rest(0.0, 10.0, Random(5))
    fuse(made, 0.2, 0.0, slip=1e-12)
    assert made.slipped
    assert made.error == pytest.approx(0.2, abs=2e-3)
    fuse(made, 0.0, 0.0, slip=1e-12)
    assert not made.slipped


def test_without_a_gyro_nothing_moves_and_both_grow_equally_unsure() -> None:
    made = at_rest(0.02, 10.0, Random(6))
    error, variance = made.error, made.variance(0.0)
    fuse(made, 0.2, 0.0)
    assert made.slipped
    error, variance = made.error, made.variance(0.0)
    for _ in range(100):
        made.roll(1e-4, DT_S)
    assert (made.error, made.slipped) == (error, False)
    assert made.variance(0.0) == pytest.approx(variance + 1e-2)
    # It is back: the turn meanwhile was the wheels', and is no slip.
    fuse(made, 0.0, 0.02 * DT_S)
    assert (made.error, made.slipped) == (pytest.approx(error, abs=1e-4), False)


def test_a_gyro_of_another_scale_is_not_learned_from_wheels_but_makes_the_heading_unsure() -> None:
    made = at_rest(0.0, 10.0, Random(7))
    for _ in range(100):
        fuse(made, 0.05, 0.04, slip=0.04 * 0.05)
    assert made.error == pytest.approx(1.0, abs=5e-3)
    turned = 100 * 0.04
    grown = made.variance(0.01) - made.variance(0.0)
    assert math.sqrt(grown) == pytest.approx(0.01 * turned, rel=0.02)
    for _ in range(100):
        fuse(made, -0.05, -0.04, slip=0.04 * 0.05)
    # Turning back undoes the effect of the scale.
    assert made.variance(0.01) - made.variance(0.0) < 0.01 * grown


def test_after_a_reset_both_headings_are_right_and_the_bias_is_still_known() -> None:
    made = at_rest(0.05, 10.0, Random(8))
    fuse(made, 0.3, 0.1, slip=0.04)
    bias = made.bias, made.bias_variance
    made.reset()
    assert (made.error, made.variance(0.01)) == (0.0, 0.0)
    assert (made.bias, made.bias_variance) == bias


def test_what_fits_worse_is_doubted_more() -> None:
    good, bad = HeadingFilter(), HeadingFilter()
    random = Random(9)
    for _ in range(250):
        wheels, gyro = random.gauss(0.02, 2e-3), 0.02
        fuse(good, wheels, gyro, slip=4e-6)
        fuse(bad, wheels, gyro, slip=1e-12)
    assert bad.doubt > good.doubt + 10.0


def test_the_covariance_is_that_of_the_equations_in_matrices() -> None:
    """Written out with numpy, in the form that is right for any gain."""
    made = HeadingFilter()
    x, p = np.zeros(4), np.diag([0.0, 0.0, BIAS_RAD_S**2, LATE_S**2])
    transition = np.eye(4)
    transition[1, 2] = DT_S
    apart, random, pull = 0.0, Random(10), np.zeros(4)
    for _ in range(200):
        wheels, gyro = random.gauss(0.0, 0.02), random.gauss(0.0, 0.02)
        slip, rate = 0.04 * abs(wheels), gyro / DT_S
        h = np.array([1.0, -1.0, 0.0, rate])
        fuse(made, wheels, gyro, slip=slip, rate=rate)
        x = transition @ x
        pull = transition @ pull + gyro * np.array([0.0, 1.0, 0.0, 0.0])
        p = transition @ p @ transition.T + np.diag([slip, NOISE, 1e-8 * DT_S, 0.0])
        apart += wheels - gyro
        innovation, expected = apart - h @ x, h @ p @ h + UNSURE
        if innovation**2 > 25.0 * expected:
            p[0, 0] += innovation**2 - expected
            expected = innovation**2
        gain = p @ h / expected
        x = x + gain * innovation
        pull = pull - gain * (h @ pull)
        rest = np.eye(4) - np.outer(gain, h)
        p = rest @ p @ rest.T + np.outer(gain, gain) * (expected - h @ p @ h)
    assert (made.error, made.bias) == pytest.approx((x[0], x[2]), rel=1e-6, abs=1e-9)
    assert made.variance(0.0) == pytest.approx(p[0, 0], rel=1e-6)
    assert made.bias_variance == pytest.approx(p[2, 2], rel=1e-6)
    scaled = made.variance(0.5) - made.variance(0.0)
    assert scaled == pytest.approx((0.5 * pull[0]) ** 2, rel=1e-6)


def test_samples_that_are_late_are_no_slip() -> None:
    late_s, turned = 0.018, 0.0
    made, before = at_rest(0.0, 10.0, Random(11)), 0.0
    slips = 0
    for number in range(1500):
        rate = 1.5 * math.sin(number * DT_S)
        turned += rate * DT_S
        # The gyro's integral lags by the base's turn meanwhile.
        behind = turned - late_s * rate
        fuse(made, rate * DT_S, behind - before, slip=1e-12, rate=rate)
        slips += made.slipped
        before = behind
    assert slips == 0
    assert made.error == pytest.approx(0.0, abs=1e-3)


def test_a_bias_that_is_not_measured_wanders() -> None:
    made = at_rest(0.0, 20.0, Random(6))
    before = made.bias_variance
    for _ in range(2500):
        made.roll(0.0, DT_S)
    # 0.1 mrad/s in the root of a second, for 100 s.
    assert made.bias_variance - before == pytest.approx(1e-4**2 * 100.0)


def test_before_the_first_step_nothing_is_doubted() -> None:
    made = HeadingFilter()
    assert (made.error, made.bias, made.doubt, made.slipped) == (0.0, 0.0, 0.0, False)


def test_a_doubt_is_minus_the_logarithm_of_a_likelihood() -> None:
    made = HeadingFilter()
    fuse(made, 0.01, 0.0, slip=1e-4)
    expected = 1e-4 + NOISE + (BIAS_RAD_S * DT_S) ** 2 + UNSURE
    assert made.doubt == pytest.approx(0.5 * (0.01**2 / expected + math.log(expected)))


def test_a_bias_that_was_set_is_of_no_scale_and_of_no_heading() -> None:
    made = at_rest(0.0, 2.0, Random(12))
    for _ in range(20):
        fuse(made, 0.05, 0.04, slip=0.04 * 0.05, rate=1.0)
    error, scaled = made.error, made.variance(0.01) - made.variance(0.0)
    made.learn(0.05, 1e-4, 0.0)
    assert (made.bias, made.bias_variance, made.error) == (0.05, 1e-4, error)
    for _ in range(20):
        fuse(made, 0.05, 0.04 + 0.05 * DT_S, slip=0.04 * 0.05)
    assert made.error == pytest.approx(error + 20 * 0.01, abs=5e-3)
    grown = math.sqrt(made.variance(0.01) - made.variance(0.0)) - math.sqrt(scaled)
    assert grown == pytest.approx(0.01 * 20 * (0.04 + 0.05 * DT_S), rel=0.05)


def test_of_a_bias_that_was_set_surely_no_slip_learns_another() -> None:
    made = at_rest(0.02, 0.4, Random(13))
    for _ in range(20):
        fuse(made, 0.05, 0.04, slip=0.04 * 0.05)
    made.learn(0.05, 1e-14, 0.0)
    fuse(made, 0.3, 0.1, slip=0.04)
    assert made.bias == pytest.approx(0.05, abs=1e-6)
