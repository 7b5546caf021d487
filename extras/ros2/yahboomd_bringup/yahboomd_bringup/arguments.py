"""Arguments that all launch files share, and the robot that they name."""

from functools import lru_cache
from typing import List

from launch import Action, LaunchContext
from launch.actions import DeclareLaunchArgument, GroupAction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import PushRosNamespace, SetRemap

from yahboomd_bringup.robot import Robot


def shared_arguments() -> List[DeclareLaunchArgument]:
    """Declare the arguments of every launch file."""
    return [
        DeclareLaunchArgument(
            "config", default_value="", description="yahboomd's file; empty: the service's"
        ),
        DeclareLaunchArgument(
            "yahboomd", default_value="yahboomd", description="the program, if not on the PATH"
        ),
        DeclareLaunchArgument(
            "distro", default_value="", description="of ROS 2; empty: the one that is sourced"
        ),
    ]


def text(context: LaunchContext, name: str) -> str:
    """The value of an argument."""
    return LaunchConfiguration(name).perform(context)


def is_true(context: LaunchContext, name: str) -> bool:
    """Whether an argument is true; anything but true and 1 is not."""
    return text(context, name).lower() in ("true", "1")


def named_robot(context: LaunchContext) -> Robot:
    """The robot that the arguments name; its configuration is asked for once."""
    return _robot(*(text(context, name) for name in ("config", "yahboomd", "distro")))


def in_namespace(robot: Robot, parts: List[Action]) -> GroupAction:
    """The launch files of others in the robot's namespace, with transforms of its own."""
    own = [PushRosNamespace(robot.namespace)] if robot.namespace else []
    remaps = [SetRemap("/tf", "tf"), SetRemap("/tf_static", "tf_static")]
    return GroupAction([*own, *remaps, *parts])


@lru_cache(maxsize=None)
def _robot(config: str, command: str, distro: str) -> Robot:
    return Robot(config, command, distro)
