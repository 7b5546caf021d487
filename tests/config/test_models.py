from __future__ import annotations

from pathlib import Path

import pytest

from yahboomd.core.config import Config
from yahboomd.core.drive.arbitration import AllowedSource
from yahboomd.core.drive.kinematics import KINEMATICS, unit_geometry
from yahboomd.core.errors import ConfigError
from yahboomd.core.model import Motor
from yahboomd.core.protocol.profiles import PROFILES


def config(**sections) -> Config:
    return Config.model_validate(sections)


def test_the_default_motors_are_those_of_the_520_kit():
    assert Config().motors() == (
        Motor(name="left", wheel=0, position=1, radius_m=0.0335, ticks_per_revolution=1320.0),
        Motor(name="right", wheel=1, position=3, radius_m=0.0335, ticks_per_revolution=1320.0),
    )


def test_radius_and_counts_that_are_given_win_over_the_profile():
    motors = config(
        chassis={
            "wheel_radius_m": 0.0325,
            "ticks_per_revolution": 1000,
            "wheel_radius_multiplier": {"right": 1.02},
        }
    ).motors()
    assert [motor.radius_m for motor in motors] == pytest.approx([0.0325, 0.0325 * 1.02])
    assert {motor.ticks_per_revolution for motor in motors} == {1000.0}


def test_motors_come_in_the_order_of_the_wheels_whatever_the_file_says():
    given = {
        "right": [{"position": 2, "encoder_sign": -1}],
        "left": [{"position": 4, "command_sign": -1, "name": "port"}],
    }
    left, right = config(chassis={"motors": given}).motors()
    assert (left.name, left.wheel, left.position, left.command_sign) == ("port", 0, 4, -1)
    assert (right.name, right.wheel, right.position, right.encoder_sign) == ("right", 1, 2, -1)


def test_several_motors_of_a_side_are_numbered():
    chassis = {
        "kinematics": "skid_steer",
        "motors": {
            "left": [{"position": 1}, {"position": 2}],
            "right": [{"position": 3}, {"position": 4, "name": "tail"}],
        },
    }
    names = [motor.name for motor in config(chassis=chassis).motors()]
    assert names == ["left_1", "left_2", "right_1", "tail"]


@pytest.mark.parametrize("name", KINEMATICS)
def test_the_kinematics_carry_the_calibrated_track(name):
    base = config(
        chassis={
            "kinematics": name,
            "wheel_separation_m": 0.25,
            "wheel_base_m": 0.1,
            "wheel_separation_multiplier": 2.0,
        }
    ).kinematics()
    assert base == KINEMATICS[name](separation_m=0.5, base_m=0.1)
    assert base.wheels == unit_geometry(name).wheels


def test_a_preset_is_taken_in_before_and_after_it_is_resolved():
    given = config(chassis={"preset": "4wd"})
    assert given.kinematics().name == given.resolved().chassis.kinematics == "skid_steer"
    assert given.motors() == given.resolved().motors()
    assert [motor.position for motor in given.motors()] == [1, 2, 3, 4]


def test_a_named_profile_is_the_protocols_own():
    assert config(board={"profile": "310"}).profile() is PROFILES["310"]


def test_a_custom_profile_is_made_of_its_figures():
    board = {"profile": "custom", "lines": 13, "ratio": 20.409, "wheel_diameter_mm": 48.0}
    given = config(board={**board, "motor_type": 2, "deadzone": 1600})
    assert given.ticks_per_revolution() == pytest.approx(13 * 20.409 * 4)
    assert given.radius_m("left") == pytest.approx(0.024)
    assert given.profile().stored == {"motor_type": 2, "deadzone": 1600}


def test_a_custom_profile_may_follow_from_the_chassis():
    given = config(
        board={"profile": "custom"},
        chassis={"ticks_per_revolution": 1320, "wheel_radius_m": 0.04},
    ).profile()
    assert given.ticks_per_revolution == pytest.approx(1320)
    assert given.wheel_diameter_mm == pytest.approx(80.0)


def test_a_custom_profile_that_no_board_can_store_is_refused_by_name():
    chassis = {"ticks_per_revolution": 1_000_000, "wheel_radius_m": 0.0004}
    given = config(board={"profile": "custom"}, chassis=chassis)
    with pytest.raises(ConfigError, match=r"gear ratio 22727\..*, wheel diameter 0\.8"):
        given.profile()


def test_a_source_without_a_timeout_has_the_common_one():
    assert Config().source_timeout_s("cmd_vel") == 0.5
    assert Config().source_timeout_s("cmd_vel/teleop") == 0.3
    assert Config().sources() == (
        AllowedSource(name="cmd_vel", priority=10, timeout_s=0.5),
        AllowedSource(name="cmd_vel/teleop", priority=100, timeout_s=0.3),
        AllowedSource(name="cmd_vel/web", priority=50, timeout_s=0.3),
        AllowedSource(name="cmd_vel/moves", priority=5, timeout_s=0.3),
    )


def test_keys_and_joints_are_named_once():
    given = config(zenoh={"namespace": "bot1"}, ros2={"joint_names": {"left": "port_joint"}})
    assert given.key("cmd_vel") == "bot1/cmd_vel"
    assert Config().key("cmd_vel") == "cmd_vel"
    assert given.joint_name("left") == "port_joint"
    assert given.joint_name("right") == "right_wheel_joint"


@pytest.mark.parametrize(
    ("environ", "user_id", "path"),
    [
        ({"RUNTIME_DIRECTORY": "/run/a:/run/b", "XDG_RUNTIME_DIR": "/x"}, 0, "/run/a/estop"),
        ({"XDG_RUNTIME_DIR": "/x"}, 0, "/run/yahboomd/estop"),
        ({"XDG_RUNTIME_DIR": "/run/user/5"}, 5, "/run/user/5/yahboomd/estop"),
        ({}, 5, "/tmp/yahboomd-5/estop"),
    ],
)
def test_the_latch_lies_in_the_runtime_directory(environ, user_id, path):
    assert Config().latch_path(environ, user_id=user_id) == Path(path)


def test_robots_on_one_machine_have_latches_of_their_own():
    paths = {
        config(zenoh={"namespace": name}).latch_path({}, user_id=0)
        for name in ("", "a", "a/b", "a_b", "a.b")
    } | {
        config(serial={"port": port}).latch_path({}, user_id=0)
        for port in ("/dev/ttyUSB0", "/dev/ttyUSB1", "/tmp/board", f"/dev/{'x' * 4000}")
    }
    assert len(paths) == 9
    assert all(len(path.name) < 256 for path in paths)
    assert {path.parent for path in paths} == {Path("/run/yahboomd")}


def test_a_latch_file_that_is_given_is_used():
    given = config(estop={"latch_file": "/var/lib/e"}, zenoh={"namespace": "a"})
    assert given.latch_path({"RUNTIME_DIRECTORY": "/run/a"}, user_id=0) == Path("/var/lib/e")
