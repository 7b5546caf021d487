"""A car's turn is weighed between its rear wheels and its steering."""

from __future__ import annotations

import pytest

from yahboomd.core.odometry.steering import ARRIVES_NS, Steering

BASE_M = 0.235
MS = 1_000_000


@pytest.fixture
def steering() -> Steering:
    made = Steering(BASE_M)
    made.command(2.0, 0)
    return made


def test_the_turn_is_between_both_by_their_variances(steering: Steering) -> None:
    own = (0.02 / BASE_M) ** 2 * 0.01  # a degree of play, over a centimetre
    for variance in (own / 9.0, own, 9.0 * own):
        extra, left = steering.correct(0.01, 0.018, variance, ARRIVES_NS)
        share = variance / (variance + own)
        assert 0.018 + extra == pytest.approx(0.018 + share * 0.002)
        assert left == pytest.approx(variance * own / (variance + own))
        assert left < min(variance, own)


def test_backwards_the_same_curve_turns_the_other_way(steering: Steering) -> None:
    extra, _ = steering.correct(-0.01, -0.018, 1e-4, ARRIVES_NS)
    assert extra < 0.0


def test_until_the_servo_has_arrived_the_wheels_are_believed(steering: Steering) -> None:
    assert steering.correct(0.01, 0.0, 1e-6, ARRIVES_NS - 1) == (0.0, 1e-6)
    steering.command(-2.0, 1000 * MS)
    assert steering.correct(0.01, 0.0, 1e-6, 1299 * MS) == (0.0, 1e-6)
    assert steering.correct(0.01, 0.0, 1e-6, 1300 * MS)[0] < 0.0


def test_the_same_curve_again_is_no_change(steering: Steering) -> None:
    for now in range(0, 1000, 20):
        steering.command(2.001, now * MS)
    assert steering.correct(0.01, 0.0, 1e-6, 1000 * MS)[0] > 0.0


def test_before_a_command_and_at_rest_nothing_is_added(steering: Steering) -> None:
    assert Steering(BASE_M).correct(0.01, 0.02, 1e-6, ARRIVES_NS) == (0.0, 1e-6)
    assert steering.correct(0.0, 0.0, 0.0, ARRIVES_NS) == (0.0, 0.0)


@pytest.mark.parametrize(("other", "counts"), [(2.03, False), (1.97, False), (2.018, True)])
def test_a_curve_that_differs_by_a_fiftieth_of_a_metre_is_another(
    steering: Steering, other: float, counts: bool
) -> None:
    steering.command(other, 1000 * MS)
    extra, _ = steering.correct(0.01, 0.0, 1e-6, 1299 * MS)
    assert (extra > 0.0) is counts


def test_a_car_that_does_not_roll_is_not_turned_by_its_steering(steering: Steering) -> None:
    assert steering.correct(0.0, 0.01, 1e-4, ARRIVES_NS) == (0.0, 1e-4)
