"""Shows the robot, its scan and its map; on a machine with a screen."""

import os

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    """Start RViz; it needs no yahboomd on its machine."""
    share = get_package_share_directory("yahboomd_bringup")
    fixed = LaunchConfiguration("fixed_frame")
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "fixed_frame", default_value="odom", description="map, where there is one"
            ),
            DeclareLaunchArgument("namespace", default_value="", description="of the robot"),
            Node(
                package="rviz2",
                executable="rviz2",
                namespace=LaunchConfiguration("namespace"),
                arguments=["-d", os.path.join(share, "rviz", "robot.rviz"), "-f", fixed],
                remappings=[("/tf", "tf"), ("/tf_static", "tf_static")],
                output="screen",
            ),
        ]
    )
