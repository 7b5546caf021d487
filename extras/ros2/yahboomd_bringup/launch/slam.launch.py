"""Builds a map while the robot drives: slam_toolbox with this base's frames."""

import os

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from yahboomd_bringup.arguments import in_namespace, named_robot, shared_arguments, text
from yahboomd_bringup.parameters import merged, packaged, written


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments."""
    return LaunchDescription(
        [
            *shared_arguments(),
            DeclareLaunchArgument("scan_topic", default_value="scan", description="of the lidar"),
            OpaqueFunction(function=_start),
        ]
    )


def _start(context):
    robot = named_robot(context)
    tree = merged(
        packaged("slam_toolbox", "config", "mapper_params_online_async.yaml"),
        robot.parameters("slam_toolbox"),
    )
    tree["slam_toolbox"]["ros__parameters"]["scan_topic"] = text(context, "scan_topic")
    share = get_package_share_directory("slam_toolbox")
    mapper = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(os.path.join(share, "launch", "online_async_launch.py")),
        launch_arguments={
            # Its launch file knows no namespace, and its parameters name the node without one.
            "slam_params_file": written({f"/**/{name}": tree[name] for name in tree}, "slam"),
            "use_sim_time": "false",
        }.items(),
    )
    return [in_namespace(robot, [mapper])]
