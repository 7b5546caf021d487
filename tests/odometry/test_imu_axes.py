"""Readings of a sensor that is mounted in any direction come out along the axes of the base."""

from __future__ import annotations

from itertools import permutations, product
from random import Random

import msgspec
import pytest

from yahboomd.core.model import ImuReading, ImuSensor, Twist2d
from yahboomd.core.odometry.imu_axes import Mounting, axes_problem
from yahboomd.simulation.imu import GRAVITY_M_S2, ImuModel, ImuOptions

SENSOR = ImuSensor(
    name="any",
    gyro_limit_rad_s=8.0,
    gyro_noise_rad_s=0.001,
    acceleration_limit_m_s2=20.0,
    acceleration_noise_m_s2=0.01,
)
ALL = [
    " ".join(sign + axis for sign, axis in zip(signs, axes, strict=True))
    for axes in permutations("xyz")
    for signs in product(("", "-"), repeat=3)
]
ROTATIONS = [axes for axes in ALL if not axes_problem(axes, rotation=True)]


def shown(axes: str) -> ImuReading:
    sample = ImuModel(ImuOptions(axes=axes), Random(1)).sample(0, Twist2d(vx=1.0, wz=0.5), 0.0)
    return ImuReading(
        sensor=SENSOR,
        sent_ns=0,
        gyro_rad_s=sample.gyro_rad_s,
        acceleration_m_s2=sample.acceleration_m_s2,
        magnetic_t=sample.magnetic_t,
    )


@pytest.mark.parametrize("axes", ROTATIONS)
def test_however_it_is_mounted_the_base_reads_the_same(axes: str) -> None:
    reading = Mounting(axes, axes).along_base(shown(axes))
    assert reading.gyro_rad_s == (0.0, 0.0, 0.5)
    assert reading.acceleration_m_s2 == (0.0, 0.5, GRAVITY_M_S2)
    assert reading.magnetic_t == (20e-6, 0.0, -44e-6)


def test_half_of_all_words_are_rotations() -> None:
    assert len(ALL) == 48
    assert len(ROTATIONS) == 24
    assert {"x y z", "x -y -z", "-y x z", "z x y"} <= set(ROTATIONS)
    assert not any(axes_problem(axes, rotation=False) for axes in ALL)


@pytest.mark.parametrize("axes", ["", "x y", "x y y", "x y w", "x y z z", "+x y z", "--x y z"])
def test_other_words_are_refused(axes: str) -> None:
    assert "once each" in axes_problem(axes, rotation=False)


def test_the_gyro_has_signs_and_a_factor_of_its_own() -> None:
    reading = Mounting("x y z", "x -y -z", gyro_factor=1.02).along_base(shown("x y z"))
    assert reading.gyro_rad_s[2] == pytest.approx(-0.51)
    assert reading.acceleration_m_s2[2] == GRAVITY_M_S2


def test_without_axes_of_its_own_it_is_mounted_as_its_board_is_built() -> None:
    sensor = msgspec.structs.replace(SENSOR, axes="x -y -z")
    reading = Mounting("", "", gyro_factor=1.02).along_base(
        msgspec.structs.replace(shown("x -y -z"), sensor=sensor)
    )
    assert reading.gyro_rad_s[2] == pytest.approx(0.51)
    assert reading.acceleration_m_s2 == (0.0, 0.5, GRAVITY_M_S2)


def test_a_sensor_without_a_magnetometer_shows_none() -> None:
    bare = ImuReading(
        sensor=SENSOR, sent_ns=0, gyro_rad_s=(0.0, 0.0, 0.0), acceleration_m_s2=(0.0, 0.0, 9.8)
    )
    assert Mounting().along_base(bare).magnetic_t is None
