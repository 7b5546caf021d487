"""Builders for the tests of this room: bases, motors, and sources that may drive."""

from __future__ import annotations

import pytest

from yahboomd.core.drive.arbitration import AllowedSource
from yahboomd.core.drive.kinematics import differential, mecanum
from yahboomd.core.model import Kinematics


@pytest.fixture
def two_wheels() -> Kinematics:
    return differential(separation_m=0.150)


@pytest.fixture
def four_rollers() -> Kinematics:
    return mecanum(separation_m=0.2, base_m=0.16)


@pytest.fixture
def sources() -> tuple[AllowedSource, ...]:
    return (
        AllowedSource(name="cmd_vel", priority=10, timeout_s=0.5),
        AllowedSource(name="planner", priority=10, timeout_s=0.5),
        AllowedSource(name="cmd_vel/teleop", priority=100, timeout_s=0.3),
    )
