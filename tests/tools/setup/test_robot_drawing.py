from __future__ import annotations

import pytest

from yahboomd.core.drive.kinematics import KINEMATICS, unit_geometry
from yahboomd.tools.setup.robot_drawing import picture, wheels_of


@pytest.mark.parametrize("kinematics", KINEMATICS)
def test_every_driven_wheel_has_its_number_in_the_picture(kinematics: str) -> None:
    wheels = wheels_of(unit_geometry(kinematics))
    drawn = picture(unit_geometry(kinematics))
    assert [f"[{number}]" in drawn for number in range(1, 6)] == [
        number <= len(wheels) for number in range(1, 6)
    ]
    assert drawn.index("front") < drawn.index("[1]")
