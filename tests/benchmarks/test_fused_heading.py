"""The figures of wheels and gyro, in a short form: the long one is ``make heading``."""

from __future__ import annotations

import pytest

from benchmarks.fused_heading import CASES, Case, Figures, figures, one, turned

# 99 % of chi-squared with as many degrees of freedom as runs, over their number.
RUNS, NEES_MOST = 4, 3.72


def driven(sensor: str, geometry: str, seconds: float = 60.0) -> Figures:
    return figures([one(seed, sensor, Case(geometry), seconds) for seed in range(RUNS)])


@pytest.mark.parametrize("sensor", ["mpu9250", "icm20948"])
def test_on_a_floor_that_varies_the_heading_is_ten_times_better_than_the_wheels(
    sensor: str,
) -> None:
    found = driven(sensor, "skid_steer")
    assert found.wheels > 0.05
    assert max(found.ratio, found.median, found.p95) < 0.1
    assert found.nees < NEES_MOST
    assert found.bias < 1e-3


def test_on_a_base_that_does_not_slip_it_is_the_wheels() -> None:
    found = driven("icm20948", "differential")
    assert max(found.median, found.p95) < 1.05
    assert found.fused < 2e-3


@pytest.mark.parametrize("name", ["shaking", "one-sided slip", "rollers", "skid steer, wrong sign"])
def test_what_makes_a_heading_wrong_is_in_its_variance(name: str) -> None:
    runs = [one(seed, "icm20948", CASES[name], 60.0) for seed in range(RUNS)]
    found = figures(runs)
    assert max(found.nees, found.nees_way) < NEES_MOST
    assert found.worse <= 0.05


def test_a_base_that_shakes_without_a_slip_keeps_the_heading_of_its_wheels() -> None:
    found = figures([one(seed, "mpu9250", CASES["shaking"], 60.0) for seed in range(RUNS)])
    assert found.fused < 2e-3


@pytest.mark.parametrize("rate", [0.03, 0.2, 1.0])
def test_an_even_turn_of_a_standing_base_is_in_the_variance_or_in_the_heading(rate: float) -> None:
    found = figures([turned(seed, "mpu9250", rate) for seed in range(RUNS)])
    assert found.nees_way < NEES_MOST
