"""The gyro's integral is exact within its limits, and is withheld when it cannot be believed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from random import Random

import pytest

from yahboomd.core.odometry.gyro import (
    CORNER,
    FROZEN_SAMPLES,
    PROBATION_NS,
    SATURATED_SHARE,
    SILENT_NS,
    Gyro,
    GyroTurn,
)

MS = 1_000_000
GAP_NS = 40 * MS


class Sampled:
    """A gyro that is handed a rate every 40 ms; its noise is in the accelerometer's last digit."""

    def __init__(self) -> None:
        self.gyro = Gyro()
        self.now_ns = 1_000_000_000
        self.number = 0

    def show(self, rate: float, *, frozen: bool = False) -> None:
        self.now_ns += GAP_NS
        self.number += not frozen
        self.gyro.accept(
            self.now_ns,
            rate,
            shown=((0.0, 0.0, rate), (0.0, 0.0, 9.8 + 1e-3 * (self.number % 7))),
            limit_rad_s=8.0,
            noise_rad_s=1e-3,
        )

    def run(self, rates: Iterable[float]) -> None:
        for rate in rates:
            self.show(rate)


@pytest.fixture
def sampled() -> Sampled:
    made = Sampled()
    made.run([0.0] * 3)
    return made


@pytest.mark.parametrize(
    ("rate", "integral"),
    [
        (lambda t: 0.5, lambda t: 0.5 * t),
        (lambda t: 1.5 * t, lambda t: 0.75 * t * t),
        (lambda t: math.sin(3.0 * t), lambda t: (1.0 - math.cos(3.0 * t)) / 3.0),
    ],
)
def test_the_integral_is_that_of_the_rate(
    rate: Callable[[float], float], integral: Callable[[float], float]
) -> None:
    sampled = Sampled()
    sampled.run([rate(0.04 * n) for n in range(101)])
    assert sampled.gyro.turn(sampled.now_ns).angle == pytest.approx(integral(4.0), abs=0.012)


def test_it_is_carried_on_to_the_moment_of_the_counters(sampled: Sampled) -> None:
    sampled.run([1.0] * 10)
    before = sampled.gyro.turn(sampled.now_ns)
    after = sampled.gyro.turn(sampled.now_ns + 20 * MS)
    assert after.angle - before.angle == pytest.approx(0.02)
    assert after.held == 0.0
    sampled.show(2.0)
    assert sampled.gyro.turn(sampled.now_ns + 20 * MS).held == pytest.approx(0.01)


def test_noise_is_handed_out_once_and_is_larger_where_the_rate_bends(sampled: Sampled) -> None:
    sampled.gyro.turn(sampled.now_ns)
    sampled.show(0.0)
    flat = sampled.gyro.turn(sampled.now_ns).noise
    assert flat == pytest.approx((1e-3 * 0.04) ** 2)
    assert sampled.gyro.turn(sampled.now_ns).noise == 0.0
    sampled.show(1.0)
    assert sampled.gyro.turn(sampled.now_ns).noise > 100.0 * flat
    sampled.show(5.0)
    # By 5 - 2 * 1 + 0.
    assert sampled.gyro.turn(sampled.now_ns).noise == pytest.approx(
        (0.04 * CORNER * 3.0) ** 2, rel=1e-3
    )
    sampled.show(7.0)
    assert sampled.gyro.turn(sampled.now_ns).noise == pytest.approx(
        (0.04 * CORNER * 2.0) ** 2, rel=1e-3
    )


def test_without_samples_it_is_silent_until_it_has_behaved_for_a_second(sampled: Sampled) -> None:
    gyro = sampled.gyro
    gyro.turn(sampled.now_ns + SILENT_NS)
    assert gyro.believed
    gyro.turn(sampled.now_ns + SILENT_NS + 1)
    assert (gyro.believed, gyro.problem) == (False, "silent")
    sampled.now_ns += 10 * SILENT_NS
    sampled.run([0.0] * (PROBATION_NS // GAP_NS))
    assert not gyro.believed
    sampled.run([0.0] * 2)
    assert (gyro.believed, gyro.problem) == (True, None)


def test_a_gap_between_two_samples_is_noticed_by_itself(sampled: Sampled) -> None:
    sampled.now_ns += SILENT_NS
    sampled.show(0.0)
    assert sampled.gyro.problem == "silent"


@pytest.mark.parametrize("rate", [SATURATED_SHARE * 8.0, -7.95, 9.0])
def test_at_its_limit_it_is_saturated(sampled: Sampled, rate: float) -> None:
    sampled.show(rate)
    assert (sampled.gyro.believed, sampled.gyro.problem) == (False, "saturated")


def test_near_its_limit_it_is_believed(sampled: Sampled) -> None:
    sampled.show(7.9)
    assert sampled.gyro.believed


def test_a_second_begins_again_with_every_problem(sampled: Sampled) -> None:
    sampled.show(9.0)
    sampled.run([0.0] * 20)
    sampled.show(9.0)
    sampled.run([0.0] * 20)
    assert not sampled.gyro.believed


def test_one_that_shows_the_very_same_again_and_again_is_stuck(sampled: Sampled) -> None:
    for _ in range(FROZEN_SAMPLES):
        sampled.show(0.5, frozen=True)
    assert sampled.gyro.believed
    sampled.show(0.5, frozen=True)
    assert (sampled.gyro.believed, sampled.gyro.problem) == (False, "implausible")


def test_a_rate_that_is_no_number_is_implausible(sampled: Sampled) -> None:
    sampled.show(math.nan)
    assert sampled.gyro.problem == "implausible"
    turn = sampled.gyro.turn(sampled.now_ns + 20 * MS)
    assert (turn.angle, turn.rate_rad_s) == (0.0, 0.0)


def test_samples_out_of_order_change_nothing(sampled: Sampled) -> None:
    angle = sampled.gyro.turn(sampled.now_ns).angle
    sampled.now_ns -= GAP_NS
    sampled.show(5.0)
    assert sampled.gyro.turn(sampled.now_ns).angle == angle


def test_before_its_first_sample_there_is_no_gyro_and_nothing_is_wrong() -> None:
    gyro = Gyro()
    assert gyro.turn(10**12) == GyroTurn(angle=0.0, rate_rad_s=0.0, noise=0.0, held=0.0)
    assert (gyro.present, gyro.believed, gyro.problem) == (False, False, None)


def test_after_a_silence_the_first_sample_counts_and_after_saturation_the_first_good_one(
    sampled: Sampled,
) -> None:
    whole = PROBATION_NS // GAP_NS
    sampled.now_ns += SILENT_NS
    sampled.show(0.0)
    sampled.run([0.0] * (whole - 1))
    assert not sampled.gyro.believed
    sampled.show(0.0)
    assert sampled.gyro.believed
    sampled.show(9.0)
    sampled.run([0.0] * whole)
    assert not sampled.gyro.believed
    sampled.show(0.0)
    assert sampled.gyro.believed


def test_before_anything_turned_it_has_no_noise() -> None:
    sampled = Sampled()
    sampled.show(0.0)
    assert sampled.gyro.turn(sampled.now_ns).noise == pytest.approx(0.0, abs=1e-7)


def test_a_gyro_is_silent_once_three_samples_stayed_away(sampled: Sampled) -> None:
    sampled.gyro.turn(sampled.now_ns + 3 * GAP_NS)
    assert sampled.gyro.believed
    sampled.gyro.turn(sampled.now_ns + 4 * GAP_NS)
    assert sampled.gyro.problem == "silent"


@pytest.mark.parametrize(("later_ns", "rate"), [(0, 1.0), (1, 2.0)])
def test_a_sample_of_the_same_moment_is_none(sampled: Sampled, later_ns: int, rate: float) -> None:
    sampled.show(1.0)
    sampled.now_ns += later_ns - GAP_NS
    sampled.show(2.0)
    assert sampled.gyro.turn(sampled.now_ns).rate_rad_s == rate


def test_samples_as_far_apart_as_is_no_silence_are_integrated(sampled: Sampled) -> None:
    sampled.now_ns += SILENT_NS - GAP_NS
    sampled.show(1.0)
    assert sampled.gyro.believed
    assert sampled.gyro.turn(sampled.now_ns).angle == pytest.approx(0.075)


@pytest.mark.parametrize("shakes", [0.0, 0.02, 0.1])
def test_what_shakes_the_base_is_measured_in_motion_and_is_noise(shakes: float) -> None:
    sampled, random = Sampled(), Random(1)
    for _ in range(200):
        sampled.show(random.gauss(0.0, 1e-3))
    assert sampled.gyro.shaking == 0.0
    sampled.gyro.moving = True
    for _ in range(500):
        sampled.show(0.5 + random.gauss(0.0, math.hypot(shakes, 1e-3)))
    assert math.sqrt(sampled.gyro.shaking) == pytest.approx(math.hypot(shakes, 1e-3), rel=0.2)
    sampled.gyro.turn(sampled.now_ns)
    sampled.show(0.5)
    least = 0.04 * 0.8 * math.hypot(shakes, 1e-3)
    assert math.sqrt(sampled.gyro.turn(sampled.now_ns).noise) > least
    # At rest it is not forgotten.
    sampled.gyro.moving = False
    before = sampled.gyro.shaking
    sampled.run([0.0] * 300)
    assert sampled.gyro.shaking == before


def test_a_turn_that_begins_and_ends_shakes_nothing() -> None:
    sampled = Sampled()
    sampled.gyro.moving = True
    for _ in range(20):
        sampled.run([0.0] * 5 + [0.3, 0.8, 1.0] + [1.0] * 5 + [0.8, 0.3])
    assert sampled.gyro.shaking == 0.0
