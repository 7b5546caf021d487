from __future__ import annotations

import msgspec
import pytest
from simulated_person import outcome

from yahboomd.core.drive.kinematics import unit_geometry
from yahboomd.core.errors import Refused
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.core.protocol.settings import BoardSettings
from yahboomd.tools.calibrate.estimates.wiring import WiredMotor, WiringFound
from yahboomd.tools.setup.board_law import as_drivable, drivable
from yahboomd.tools.setup.robot_drawing import wheels_of
from yahboomd.tools.setup.robot_file import as_config

STORED = BoardSettings(
    motor_type=1, deadzone=1900, lines=11, ratio=30, wheel_diameter_mm=67.0, pid=(0.8, 0.06, 0.5)
)


def ways(dialect: str, kinematics: str, settings: BoardSettings | None) -> list:
    description = outcome(kinematics).description
    wheels = wheels_of(unit_geometry(kinematics))
    return drivable(DIALECTS[dialect], settings, as_config(description, wheels), wheels)


def test_a_board_that_takes_a_speed_for_each_motor_drives_them_however_they_are_connected() -> None:
    assert len(ways("streamed", "skid_steer", STORED)) == 384
    assert len(ways("polled", "mecanum", None)) == 384
    assert len(ways("streamed", "differential", STORED)) == 4 * 3 * 2 * 2


def test_a_board_that_divides_a_motion_itself_drives_few_of_them() -> None:
    found = ways("rosmaster", "mecanum", BoardSettings(car_type=1))
    connected = [{motor.wheel: motor.position * motor.sign for motor in way} for way in found]
    usual = {"front_left": 1, "rear_left": 2, "front_right": 3, "rear_right": 4}
    assert usual in connected
    assert usual | {"rear_right": -4} not in connected
    assert usual | {"front_left": 2, "rear_left": 1} not in connected
    # The other diagonal first, the two sides exchanged, each with forward as backward.
    assert len(found) < 384 / 4


def test_a_robot_that_it_cannot_drive_at_all_is_refused_with_the_reason() -> None:
    with pytest.raises(Refused, match=r"cannot drive such a robot\. The board is set to car type"):
        ways("rosmaster", "mecanum", BoardSettings(car_type=4))


def wired(*plugs: int) -> tuple[WiredMotor, ...]:
    wheels = ("front_left", "rear_left", "front_right", "rear_right")
    return tuple(
        WiredMotor(wheel=wheel, position=abs(plug), sign=1 if plug > 0 else -1)
        for wheel, plug in zip(wheels, plugs, strict=True)
    )


def test_the_fewest_plugs_are_changed_and_each_is_named() -> None:
    verdict = WiringFound(motors=wired(2, 1, -3, 4))
    found = as_drivable(verdict, [wired(4, 3, 2, 1), wired(1, 2, 3, 4)])
    assert found.motors == wired(1, 2, 3, 4)
    words = [fault.words for fault in found.faults]
    assert [fault.arrives for fault in found.faults] == [1, 2, 3]
    assert "M2 (front left)" in words[0]
    assert words[0].endswith("into M1.")
    assert "M3 (front right) is mounted the other way round" in words[2]
    kept = msgspec.structs.replace(verdict, faults=found.faults)
    assert len(as_drivable(kept, [wired(1, 2, 3, 4)]).faults) == 6
