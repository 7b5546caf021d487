from __future__ import annotations

import math
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from yahboomd.core.config import Config
from yahboomd.tools.ros_files.node_parameters import (
    PARAMETERS,
    joystick,
    nav2,
    robot_localization,
    slam_toolbox,
)

DECLARED = tomllib.loads(Path(__file__).with_name("declared_parameters.toml").read_text())
SLOW = {
    "linear": {"velocity": 0.2, "acceleration": 0.3, "deceleration": 0.4},
    "angular": {"velocity": 0.25, "acceleration": 0.6, "deceleration": 0.7},
}
MECANUM = {"preset": "mecanum", "wheel_base_m": 0.2}
CAR = {"preset": "ackermann", "wheel_base_m": 0.2, "steering_max_rad": 0.5}


def config(**sections) -> Config:
    return Config.model_validate(sections)


def leaves(tree, path: str = "") -> Iterator[tuple[str, object]]:
    for key, value in tree.items():
        at = f"{path}.{key}" if path else key
        if isinstance(value, dict):
            yield from leaves(value, at)
        else:
            yield at, value


def of(tree, node: str) -> dict[str, object]:
    for part in node.split("."):
        tree = tree[part]
    return dict(leaves(tree["ros__parameters"]))


@pytest.mark.parametrize("chassis", [{}, MECANUM, CAR], ids=["differential", "mecanum", "car"])
@pytest.mark.parametrize("distro", ["humble", "jazzy", "kilted", "lyrical"])
@pytest.mark.parametrize("package", PARAMETERS)
def test_each_parameter_is_one_that_the_node_declares(package, distro, chassis) -> None:
    tree = PARAMETERS[package](config(chassis=chassis, ros2={"distro": distro}))
    known = DECLARED["humble" if distro == "humble" else "jazzy"] | DECLARED["any"]
    found = [name for name, _ in leaves(tree)]
    assert found
    for name in found:
        node, parameter = name.split(".ros__parameters.")
        assert parameter in known[node], name


def test_nav2_gets_the_bases_limits_where_they_are_smaller_than_its_own() -> None:
    tree = nav2(config(limits=SLOW))
    path = of(tree, "controller_server")
    assert (path["FollowPath.vx_max"], path["FollowPath.vx_min"]) == (0.2, -0.2)
    assert (path["FollowPath.ax_max"], path["FollowPath.ax_min"]) == (0.3, -0.4)
    assert (path["FollowPath.wz_max"], path["FollowPath.az_max"]) == (0.25, 0.6)
    smoother = of(tree, "velocity_smoother")
    assert smoother["max_velocity"] == [0.2, 0.0, 0.25]
    assert smoother["min_velocity"] == [-0.2, 0.0, -0.25]
    assert smoother["max_accel"] == [0.3, 0.0, 0.6]
    assert smoother["max_decel"] == [-0.4, 0.0, -0.7]
    recoveries = of(tree, "behavior_server")
    assert (recoveries["min_rotational_vel"], recoveries["max_rotational_vel"]) == (0.25, 0.25)
    assert recoveries["rotational_acc_lim"] == 0.6
    assert of(nav2(config(limits=SLOW | {"linear": {"velocity": 0.1}})), "docking_server")[
        "controller.v_linear_max"
    ] == pytest.approx(0.1)


def test_a_base_that_moves_sideways_is_driven_sideways() -> None:
    tree = nav2(config(chassis=MECANUM, limits=SLOW))
    path = of(tree, "controller_server")
    assert path["FollowPath.motion_model"] == "Omni"
    assert path["FollowPath.vy_max"] == 0.2
    assert of(tree, "velocity_smoother")["max_velocity"] == [0.2, 0.2, 0.25]
    assert of(tree, "amcl")["robot_model_type"] == "nav2_amcl::OmniMotionModel"
    pad = of(joystick(config(chassis=MECANUM, limits=SLOW)), "teleop_twist_joy_node")
    assert pad["scale_linear_turbo.y"] == 0.2
    assert "scale_linear.y" not in of(joystick(config()), "teleop_twist_joy_node")


def test_a_car_is_driven_in_curves_that_it_can_steer() -> None:
    path = of(nav2(config(chassis=CAR)), "controller_server")
    assert path["FollowPath.motion_model"] == "Ackermann"
    tightest_m = 0.2 / math.tan(0.5)
    radius_m = path["FollowPath.AckermannConstraints.min_turning_r"]
    assert tightest_m <= radius_m < tightest_m + 0.001
    assert "FollowPath.motion_model" not in of(nav2(config()), "controller_server")


@pytest.mark.parametrize("stamped", [True, False])
def test_the_type_of_commands_is_the_configurations_at_every_node_that_sends_them(stamped) -> None:
    ros2 = {"distro": "kilted", "stamped_commands": ["cmd_vel"] if stamped else []}
    said = {
        name: value
        for name, value in leaves(nav2(config(ros2=ros2)))
        if name.endswith("enable_stamped_cmd_vel")
    }
    assert len(said) == 5
    assert set(said.values()) == {stamped}
    # The joystick has a key of its own, and its own type.
    assert of(joystick(config(ros2=ros2)), "teleop_twist_joy_node")["publish_stamped_twist"] is (
        False
    )
    teleop = {"stamped_commands": ["cmd_vel/teleop"]}
    assert of(joystick(config(ros2=teleop)), "teleop_twist_joy_node")["publish_stamped_twist"]


def test_frames_and_topics_are_the_configurations() -> None:
    ours = config(
        odometry={"frame_id": "wheel_odom", "child_frame_id": "chassis"},
        ros2={"frame_prefix": "bot1/", "odom_topic": "wheel/odom"},
    )
    for tree in (nav2(ours), slam_toolbox(ours), robot_localization(ours)):
        frames = {value for name, value in leaves(tree) if "frame" in name.rpartition(".")[2]}
        assert frames == {"bot1/map", "bot1/wheel_odom", "bot1/chassis"}
    assert of(nav2(ours), "bt_navigator")["odom_topic"] == "wheel/odom"
    assert of(robot_localization(ours), "ekf_filter_node")["odom0"] == "wheel/odom"


def test_the_joystick_moves_nothing_without_its_button_and_repeats_within_the_timeout() -> None:
    ours = config(limits=SLOW)
    tree = joystick(ours)
    teleop = of(tree, "teleop_twist_joy_node")
    assert teleop["require_enable_button"] is True
    assert (teleop["scale_linear.x"], teleop["scale_linear_turbo.x"]) == (0.1, 0.2)
    assert (teleop["scale_angular.yaw"], teleop["scale_angular_turbo.yaw"]) == (0.125, 0.25)
    repeat_s = 1.0 / of(tree, "joy_node")["autorepeat_rate"]
    assert 3 * repeat_s < ours.source_timeout_s("cmd_vel/teleop")
