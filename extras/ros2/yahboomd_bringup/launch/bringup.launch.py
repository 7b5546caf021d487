"""The robot, and what else is switched on: joystick, ekf, slam, navigation, rviz."""

import os

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from yahboomd_bringup.arguments import shared_arguments

PARTS = {
    "joystick": "drive with a pad",
    "ekf": "let robot_localization publish odom to base_link",
    "slam": "build a map",
    "navigation": "drive to goals",
    "rviz": "show it on this machine's screen",
}


def generate_launch_description() -> LaunchDescription:
    """Declare a switch for each part; the arguments of the parts pass through."""
    switches = [
        DeclareLaunchArgument(name, default_value="false", description=about)
        for name, about in PARTS.items()
    ]
    parts = [
        IncludeLaunchDescription(_source(name), condition=IfCondition(LaunchConfiguration(name)))
        for name in PARTS
    ]
    return LaunchDescription(
        [
            *shared_arguments(),
            *switches,
            IncludeLaunchDescription(_source("robot")),
            *parts,
        ]
    )


def _source(name: str) -> PythonLaunchDescriptionSource:
    share = get_package_share_directory("yahboomd_bringup")
    return PythonLaunchDescriptionSource(os.path.join(share, "launch", f"{name}.launch.py"))
