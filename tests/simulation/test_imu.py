"""The simulated inertial sensor shows the truth, with the errors of its datasheet."""

from __future__ import annotations

import math
from random import Random
from statistics import fmean, stdev

import msgspec
import pytest

from yahboomd.core.model import STANDSTILL, Twist2d
from yahboomd.simulation.imu import GRAVITY_M_S2, MPU9250, SENSORS, ImuModel, ImuOptions

S = 1_000_000_000
MS = 1_000_000


def sensor(seed: int = 1, **options: object) -> ImuModel:
    return ImuModel(ImuOptions(**options), Random(seed))  # type: ignore[arg-type]


def test_a_perfect_sensor_shows_turn_gravity_and_the_pull_of_the_curve() -> None:
    imu = sensor()
    imu.sample(0, Twist2d(vx=0.5, wz=2.0), 0.0)
    shown = imu.sample(100 * MS, Twist2d(vx=0.6, wz=2.0), 0.0)
    assert shown.gyro_rad_s == (0.0, 0.0, 2.0)
    assert shown.acceleration_m_s2 == pytest.approx((1.0, 1.2, GRAVITY_M_S2))


def test_the_field_turns_against_the_robot() -> None:
    east = sensor().sample(0, STANDSTILL, -math.pi / 2.0).magnetic_t
    assert east[:2] == pytest.approx((0.0, 20e-6))


def test_axes_place_each_direction_on_the_axis_that_points_there() -> None:
    shown = sensor(axes="-y x -z").sample(0, Twist2d(vx=1.0, wz=0.5), 0.0)
    assert shown.gyro_rad_s == (0.0, 0.0, -0.5)
    # To the left, the side to which the curve pulls, is its x; up is against its z.
    assert shown.acceleration_m_s2 == pytest.approx((0.5, 0.0, -GRAVITY_M_S2))


@pytest.mark.parametrize("name", SENSORS)
def test_noise_at_rest_is_that_of_the_datasheet(name: str) -> None:
    options = msgspec.structs.replace(SENSORS[name], warming_k=0.0)
    imu = ImuModel(options, Random(2))
    turns = [imu.sample(n * 40 * MS, STANDSTILL, 0.0).gyro_rad_s[2] for n in range(5000)]
    noise = options.gyro_density * math.sqrt(options.bandwidth_hz)
    assert stdev(turns) == pytest.approx(noise, rel=0.05)
    assert fmean(turns) == pytest.approx(imu.gyro_zero_rad_s(0)[2], abs=5.0 * noise / 70.0)


def test_zeros_stay_within_the_tolerance_and_differ_from_sensor_to_sensor() -> None:
    zeros = [ImuModel(MPU9250, Random(seed)).gyro_zero_rad_s(0)[2] for seed in range(50)]
    assert len(set(zeros)) == 50
    assert max(map(abs, zeros)) <= MPU9250.gyro_zero_rad_s[2]
    assert max(map(abs, zeros)) > 0.8 * MPU9250.gyro_zero_rad_s[2]


def test_the_zero_drifts_while_the_board_warms_up_and_then_stays() -> None:
    imu = ImuModel(MPU9250, Random(3))
    start, warm, later = (imu.gyro_zero_rad_s(seconds * S)[2] for seconds in (0, 3000, 6000))
    drift = abs(warm - start) / MPU9250.warming_k
    assert 0.1 * MPU9250.gyro_drift_rad_s_k[2] < drift <= MPU9250.gyro_drift_rad_s_k[2]
    assert later == pytest.approx(warm, abs=1e-5)


def test_a_turn_beyond_the_limit_saturates() -> None:
    shown = sensor(gyro_limit_rad_s=3.0).sample(0, Twist2d(wz=-7.0), 0.0)
    assert shown.gyro_rad_s == (0.0, 0.0, -3.0)


def test_the_scale_is_off_by_a_share_within_its_tolerance() -> None:
    shown = [
        sensor(seed, gyro_scale=0.03).sample(0, Twist2d(wz=1.0), 0.0).gyro_rad_s[2]
        for seed in range(20)
    ]
    assert 0.01 < max(abs(turn - 1.0) for turn in shown) <= 0.03


def test_a_gyro_can_be_made_to_show_something_else() -> None:
    imu = sensor()
    imu.forced_gyro_rad_s = (1.0, 2.0, 3.0)
    assert imu.sample(0, STANDSTILL, 0.0).gyro_rad_s == (1.0, 2.0, 3.0)


def test_one_seed_is_one_sensor() -> None:
    first, second = (ImuModel(MPU9250, Random(7)).sample(S, Twist2d(wz=0.1), 0.2) for _ in range(2))
    assert first == second
