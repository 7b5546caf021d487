from __future__ import annotations

import pytest
from pydantic import ValidationError

from yahboomd.core.config.driving import AxisLimits, Command, Estop, Faults, Limits
from yahboomd.core.drive import limiter


def test_the_default_limits_are_those_of_the_limiter_without_jerk():
    assert Limits().linear.noun() == limiter.AxisCaps(
        velocity=1.0, acceleration=2.5, deceleration=5.0
    )
    assert Limits().angular.noun() == limiter.AxisCaps(
        velocity=6.0, acceleration=12.0, deceleration=24.0
    )


def test_what_is_missing_in_a_table_is_unlimited():
    assert AxisLimits(velocity=1.0).noun() == limiter.AxisCaps(velocity=1.0)


@pytest.mark.parametrize("value", [0.0, -1.0, float("inf"), float("nan"), True, "1"])
def test_a_limit_is_a_finite_number_above_zero(value):
    with pytest.raises(ValidationError):
        AxisLimits.model_validate({"jerk": value})


def test_teleoperation_wins_over_navigation_by_default():
    sources = Command().sources
    assert sources["cmd_vel/teleop"].priority > sources["cmd_vel"].priority
    assert sources["cmd_vel/teleop"].timeout_s == 0.3


@pytest.mark.parametrize("name", ["yahboomd/estop", "/cmd_vel", "cmd_vel/*", ""])
def test_a_source_needs_a_key_of_its_own(name):
    with pytest.raises(ValidationError):
        Command.model_validate({"sources": {name: {}}})


def test_a_stall_stops_and_a_hand_on_a_wheel_is_reported():
    assert (Faults().stall, Faults().turns_without_command) == ("stop", "report")


def test_the_latch_file_is_an_absolute_path():
    assert Estop.model_validate({"latch_file": "/run/estop"}).latch_file == "/run/estop"
    with pytest.raises(ValidationError):
        Estop.model_validate({"latch_file": "estop"})
