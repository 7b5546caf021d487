"""The public contract of a Rosmaster X3 that others run: what of it the base's topics keep.

It is `real_robot_contract.yaml` of AIRclub-UdeSA/yahboom_rosmaster (2026-09-24), measured on their
robot. Camera and lidar have nodes of their own. docs/ros2.md has the settings.
"""

from __future__ import annotations

import pytest

from yahboomd.core.config import Config, read
from yahboomd.ros2 import ros2_topics
from yahboomd.ros2.ros2_plane import topics

TYPES = {
    "odom": "nav_msgs/msg/Odometry",
    "joint_states": "sensor_msgs/msg/JointState",
    "imu/data": "sensor_msgs/msg/Imu",
    "imu/data_raw": "sensor_msgs/msg/Imu",
    "diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
}
JOINTS = {f"{end}_{side}_wheel_joint" for end in ("front", "back") for side in ("left", "right")}
RADIUS_M, TICKS = 0.0325, 1040.0
AS_THEIRS = (
    'odometry.child_frame_id="base_footprint"',
    'ros2.joint_names={rear_left="back_left_wheel_joint",rear_right="back_right_wheel_joint"}',
)


def config(*more: str) -> Config:
    x3 = (
        *('board.profile="x3"', 'chassis.preset="mecanum"'),
        *("chassis.wheel_base_m=0.16", "chassis.wheel_separation_m=0.17"),
    )
    return read(None, environ={}, overrides=[*x3, *more]).config


def test_an_x3_has_the_topics_types_and_wheels_of_the_contract() -> None:
    assert {name: ros2_topics.ROS_TOPICS[name].ros_type for name in TYPES} == TYPES
    car = config()
    ours = topics(car)
    assert (ours.odom, ours.joint_states, ours.imu) == ("odom", "joint_states", "imu")
    assert (ours.frame_id, ours.imu_frame_id) == ("odom", "imu_link")
    assert car.command.timeout_s == 0.5
    for motor in car.motors():
        assert motor.radius_m == RADIUS_M
        # Theirs is read from a parameter file; ours from the firmware, for the car type X3.
        assert motor.ticks_per_revolution == 1320.0 != TICKS


@pytest.mark.parametrize("settings", [(), AS_THEIRS], ids=["ours", "as theirs"])
def test_frame_of_the_base_and_joints_differ_until_they_are_set(settings: tuple[str, ...]) -> None:
    ours = topics(config(*settings))
    same = bool(settings)
    assert (ours.child_frame_id == "base_footprint") == same
    assert ({*ours.joints} == JOINTS) == same
