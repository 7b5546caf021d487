"""Drives to goals: Nav2 with this base's frames, limits and message types."""

import os

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from yahboomd_bringup.arguments import in_namespace, named_robot, shared_arguments, text
from yahboomd_bringup.parameters import merged, namespaced, packaged, read, written


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments."""
    return LaunchDescription(
        [
            *shared_arguments(),
            DeclareLaunchArgument(
                "map", default_value="", description="a saved map; empty: slam_toolbox makes it"
            ),
            DeclareLaunchArgument(
                "robot_radius",
                default_value="",
                description="metres of the circle that holds the robot; empty: the wheels' circle",
            ),
            DeclareLaunchArgument(
                "nav2_params",
                default_value="",
                description="a file of your own, laid over the parameters of Nav2 and of the base",
            ),
            OpaqueFunction(function=_start),
        ]
    )


def _start(context):
    robot = named_robot(context)
    tree = merged(packaged("nav2_bringup", "params", "nav2_params.yaml"), robot.parameters("nav2"))
    if given := text(context, "robot_radius"):
        for costmap in ("local_costmap", "global_costmap"):
            tree[costmap][costmap]["ros__parameters"]["robot_radius"] = float(given)
    if given := text(context, "nav2_params"):
        tree = merged(tree, read(given))
    shared = {
        "params_file": written(namespaced(tree, robot.namespace), "nav2"),
        "use_sim_time": "false",
        "namespace": robot.namespace,
    }
    parts = [_part("navigation_launch.py", shared)]
    if given := text(context, "map"):
        parts.append(_part("localization_launch.py", {**shared, "map": given}))
    return [in_namespace(robot, parts)]


def _part(name: str, arguments: dict) -> IncludeLaunchDescription:
    share = get_package_share_directory("nav2_bringup")
    return IncludeLaunchDescription(
        PythonLaunchDescriptionSource(os.path.join(share, "launch", name)),
        launch_arguments=arguments.items(),
    )
