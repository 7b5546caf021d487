from __future__ import annotations

import pytest

from yahboomd.core.config import WHEELS
from yahboomd.tools.setup.robot_drawing import CORNERS, picture, wheels_of


@pytest.mark.parametrize("kinematics", WHEELS)
def test_every_driven_wheel_has_its_number_in_the_picture(kinematics: str) -> None:
    wheels = wheels_of(kinematics, WHEELS[kinematics])
    drawn = picture(kinematics, wheels)
    assert [f"[{number}]" in drawn for number in range(1, 6)] == [
        number <= len(wheels) for number in range(1, 6)
    ]
    assert drawn.index("front") < drawn.index("[1]")


@pytest.mark.parametrize("kinematics", ["skid_steer", "mecanum"])
def test_four_wheels_are_numbered_as_one_reads(kinematics: str) -> None:
    assert wheels_of(kinematics, WHEELS[kinematics]) == CORNERS
    lines = picture(kinematics, CORNERS).splitlines()
    # Front left before front right, on one line, above the rear ones.
    front = next(line for line in lines if "[1]" in line)
    rear = next(line for line in lines if "[3]" in line)
    assert front.index("[1]") < front.index("[2]")
    assert rear.index("[3]") < rear.index("[4]")
    assert lines.index(front) < lines.index(rear)


def test_two_wheels_are_left_and_right_and_a_cars_are_behind() -> None:
    assert wheels_of("differential", WHEELS["differential"]) == ("left", "right")
    lines = picture("ackermann", ("left", "right")).splitlines()
    assert next(n for n, line in enumerate(lines) if "( )" in line) < next(
        n for n, line in enumerate(lines) if "[1]" in line
    )
