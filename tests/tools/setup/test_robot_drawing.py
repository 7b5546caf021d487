from __future__ import annotations

import pytest

from yahboomd.core.drive.kinematics import KINEMATICS, unit_geometry
from yahboomd.tools.setup.robot_drawing import CORNERS, picture, wheels_of


@pytest.mark.parametrize("kinematics", KINEMATICS)
def test_every_driven_wheel_has_its_number_in_the_picture(kinematics: str) -> None:
    wheels = wheels_of(unit_geometry(kinematics))
    drawn = picture(unit_geometry(kinematics))
    assert [f"[{number}]" in drawn for number in range(1, 6)] == [
        number <= len(wheels) for number in range(1, 6)
    ]
    assert drawn.index("front") < drawn.index("[1]")


@pytest.mark.parametrize("kinematics", ["skid_steer", "mecanum"])
def test_four_wheels_are_numbered_as_one_reads(kinematics: str) -> None:
    assert wheels_of(unit_geometry(kinematics)) == CORNERS
    lines = picture(unit_geometry(kinematics)).splitlines()
    # Front left before front right, on one line, above the rear ones.
    front = next(line for line in lines if "[1]" in line)
    rear = next(line for line in lines if "[3]" in line)
    assert front.index("[1]") < front.index("[2]")
    assert rear.index("[3]") < rear.index("[4]")
    assert lines.index(front) < lines.index(rear)


def test_two_wheels_are_left_and_right_and_a_cars_are_behind() -> None:
    assert wheels_of(unit_geometry("differential")) == ("left", "right")
    lines = picture(unit_geometry("ackermann")).splitlines()
    assert next(n for n, line in enumerate(lines) if "( )" in line) < next(
        n for n, line in enumerate(lines) if "[1]" in line
    )
