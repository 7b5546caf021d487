"""The figures of wheels and gyro, in a short form: the long one is ``make heading``."""

from __future__ import annotations

import pytest

from benchmarks.fused_heading import SCALE, Figures, figures, one

# 99 % of chi-squared with as many degrees of freedom as runs, over their number.
RUNS, NEES_MOST = 4, 3.72


def driven(sensor: str, geometry: str, seconds: float = 60.0) -> Figures:
    return figures([one(seed, sensor, geometry, seconds, SCALE) for seed in range(RUNS)])


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
