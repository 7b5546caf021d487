"""The nouns."""

from __future__ import annotations

import inspect
import math

import msgspec
import pytest

from yahboomd.core import model
from yahboomd.core.model import (
    CHANNELS,
    NS_PER_S,
    STANDSTILL,
    EncoderReading,
    ImuSensor,
    Kinematics,
    Motor,
    Pose2d,
    Twist2d,
    velocity_problem,
)

NOUNS = [
    each
    for each in vars(model).values()
    if isinstance(each, type)
    and issubclass(each, msgspec.Struct)
    # A cause is a kind and a text, in this order, like a logging call.
    and each not in {msgspec.Struct, model.Cause}
]


def test_every_noun_is_frozen_built_by_name_and_explained() -> None:
    assert len(NOUNS) >= 6
    for noun in NOUNS:
        config = noun.__struct_config__
        assert config.frozen, noun
        kinds = {each.kind for each in inspect.signature(noun).parameters.values()}
        assert kinds == {inspect.Parameter.KEYWORD_ONLY}, noun
        assert inspect.getdoc(noun), noun


def test_a_standstill_is_zero_in_every_direction_and_nothing_else_is() -> None:
    assert STANDSTILL.is_zero
    assert Twist2d().is_zero
    assert not any(Twist2d(**{axis: 1e-300}).is_zero for axis in ("vx", "vy", "wz"))
    assert not Twist2d(vx=math.nan).is_zero


def test_a_tick_is_a_part_of_the_rim() -> None:
    motor = Motor(name="left", wheel=0, position=1, radius_m=0.0335, ticks_per_revolution=1320)
    assert motor.metres_per_tick == pytest.approx(math.pi * 0.067 / 1320)
    assert NS_PER_S == 10**9


def test_what_is_left_out_is_usual() -> None:
    assert Pose2d() == Pose2d(x=0.0, y=0.0, theta=0.0)
    motor = Motor(name="left", wheel=0, position=1, radius_m=0.03, ticks_per_revolution=1320)
    assert (motor.command_sign, motor.encoder_sign) == (1, 1)
    reading = EncoderReading(ticks=(0, 0, 0, 0), received_ns=2, sent_ns=1)
    assert (reading.after_reset, reading.after_gap, reading.unbroken) == (False, False, False)
    assert not Kinematics(name="none", wheels=(), inverse=(), forward=((), (), ())).holonomic


def test_the_board_has_four_channels() -> None:
    assert CHANNELS == 4


def test_a_sensor_is_true_to_a_hundredth_and_no_base_steers_unless_it_is_given() -> None:
    sensor = ImuSensor(
        name="any",
        gyro_limit_rad_s=8.0,
        gyro_noise_rad_s=1e-3,
        acceleration_limit_m_s2=20.0,
        acceleration_noise_m_s2=0.01,
    )
    assert (sensor.gyro_scale, sensor.delay_ns) == (0.01, 0)
    base = Kinematics(name="any", wheels=(), inverse=(), forward=())
    assert (base.base_m, base.least_radius_m) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("velocity", "word"),
    [
        ((100.0, -100.0, -1000.0), None),
        ((math.nan, 0.0, 0.0), "not_finite"),
        ((0.0, math.inf, 0.0), "not_finite"),
        ((0.0, 0.0, -math.inf), "not_finite"),
        ((math.nextafter(100.0, math.inf), 0.0, 0.0), "too_fast"),
        ((0.0, -math.nextafter(100.0, math.inf), 0.0), "too_fast"),
        ((0.0, 0.0, -math.nextafter(1000.0, math.inf)), "too_fast"),
    ],
)
def test_a_velocity_is_refused_beyond_what_any_robot_reaches(
    velocity: tuple[float, float, float], word: str | None
) -> None:
    problem = velocity_problem(*velocity)
    assert (problem and problem[0]) == word
