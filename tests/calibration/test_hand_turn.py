"""However a sensor is mounted and configured, a turn by hand finds what points up."""

from __future__ import annotations

import math
from itertools import permutations, product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.model import ImuReading, ImuSensor, Vector3
from yahboomd.core.odometry.imu_axes import Mounting, axes_problem
from yahboomd.tools.calibrate.estimates.hand_turn import GRAVITY_M_S2, Mounted, judge

SENSOR = ImuSensor(
    name="any",
    gyro_limit_rad_s=8.0,
    gyro_noise_rad_s=0.001,
    acceleration_limit_m_s2=20.0,
    acceleration_noise_m_s2=0.01,
)
ROTATIONS = [
    axes
    for letters in permutations("xyz")
    for signs in product(("", "-"), repeat=3)
    if not axes_problem(
        axes := " ".join(map("".join, zip(signs, letters, strict=True))), rotation=True
    )
]
mountings = st.sampled_from(ROTATIONS)


def shown(true_axes: str, vector: Vector3) -> Vector3:
    """A vector along the base, as a sensor in this mounting shows it."""
    out = [0.0, 0.0, 0.0]
    for value, word in zip(vector, true_axes.split(), strict=True):
        out["xyz".index(word[-1])] = -value if word.startswith("-") else value
    return out[0], out[1], out[2]


def read(axes: str, gyro_axes: str, turn: Vector3, force: Vector3) -> tuple[Vector3, Vector3]:
    reading = ImuReading(sensor=SENSOR, sent_ns=0, gyro_rad_s=turn, acceleration_m_s2=force)
    along = Mounting(axes, gyro_axes or axes).along_base(reading)
    return along.gyro_rad_s, along.acceleration_m_s2


@given(mountings, mountings, mountings, mountings)
def test_what_is_proposed_is_right_whatever_is_true_and_configured(
    true: str, true_gyro: str, axes: str, gyro_axes: str
) -> None:
    turn = shown(true_gyro, (0.0, 0.0, 3 * 2.0 * math.pi))
    force = shown(true, (0.0, 0.0, GRAVITY_M_S2))
    found = judge(*read(axes, gyro_axes, turn, force), 3, axes=axes, gyro_axes=gyro_axes, scale=1.0)
    assert found.doubts == ()
    assert found.gyro_scale == pytest.approx(1.0)
    for proposed in filter(None, (found.axes, found.gyro_axes)):
        assert axes_problem(proposed, rotation=True) == ""
    turned, pulled = read(found.axes, found.gyro_axes, turn, force)
    assert turned[2] == pytest.approx(6.0 * math.pi)
    assert pulled[2] == pytest.approx(GRAVITY_M_S2)


def level(angle: float, force: float = 9.8, turns: float = 1.0, scale: float = 1.0) -> Mounted:
    return judge(
        (0.0, 0.0, angle), (0.0, 0.0, force), turns, axes="x y z", gyro_axes="", scale=scale
    )


def test_one_that_is_mounted_as_configured_stays_and_gets_its_scale() -> None:
    found = level(2.0 * math.pi / 1.02, scale=0.5)
    assert (found.axes, found.gyro_axes) == ("x y z", "")
    assert found.gyro_scale == pytest.approx(0.51)
    assert found.turns == pytest.approx(1.0 / 1.02)


def test_a_gyro_of_another_sign_than_the_accelerometer_gets_axes_of_its_own() -> None:
    found = level(-2.0 * math.pi)
    assert found.axes == "x y z"
    assert found.gyro_axes.split()[2] == "-z"


@pytest.mark.parametrize("angle", [0.0, 4.9, 7.6])
def test_other_turns_than_were_asked_for_are_doubted(angle: float) -> None:
    assert "1 were asked for" in level(angle).doubts[0]


def test_a_tilted_turn_and_a_slanted_sensor_are_doubted() -> None:
    tilted = judge((0.0, 3.0, 5.6), (0.0, 0.0, 9.8), 1, axes="x y z", gyro_axes="", scale=1.0)
    assert "flat" in tilted.doubts[0]
    assert "slant" in level(2.0 * math.pi, force=7.0).doubts[0]
    assert level(2.0 * math.pi, force=9.0).doubts == ()
