"""What the tests of this room share: bases, motors, and sources that may drive."""

from __future__ import annotations

import pytest

from yahboomd.drive.arbitration import Source
from yahboomd.drive.kinematics import differential, mecanum
from yahboomd.model import Kinematics, Motor


@pytest.fixture
def two_wheels() -> Kinematics:
    return differential(separation_m=0.150)


@pytest.fixture
def four_rollers() -> Kinematics:
    return mecanum(separation_m=0.2, base_m=0.16)


@pytest.fixture
def article_motors() -> tuple[Motor, ...]:
    return tuple(
        Motor(name=name, wheel=wheel, position=position, radius_m=0.0325, ticks_per_revolution=1320)
        for wheel, (name, position) in enumerate((("left", 1), ("right", 3)))
    )


@pytest.fixture
def sources() -> tuple[Source, ...]:
    return (
        Source(name="cmd_vel", priority=10, timeout_s=0.5),
        Source(name="planner", priority=10, timeout_s=0.5),
        Source(name="cmd_vel/teleop", priority=100, timeout_s=0.3),
    )
