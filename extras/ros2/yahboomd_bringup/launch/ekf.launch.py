"""Publishes odom to base_link from the wheels and what else is added: robot_localization's EKF."""

from launch import LaunchDescription
from launch.actions import OpaqueFunction
from launch_ros.actions import Node
from yahboomd_bringup.arguments import named_robot, shared_arguments
from yahboomd_bringup.parameters import written
from yahboomd_bringup.robot import BringupError


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments."""
    return LaunchDescription([*shared_arguments(), OpaqueFunction(function=_start)])


def _start(context):
    robot = named_robot(context)
    if robot.facts["ros2"]["publish_tf"]:
        raise BringupError(
            "yahboomd publishes the transform that the EKF would publish too, and the pose would "
            "jump between the two. Set publish_tf = false under [ros2] in yahboomd's file."
        )
    tree = robot.parameters("robot_localization")
    return [
        Node(
            package="robot_localization",
            executable="ekf_node",
            name="ekf_filter_node",
            namespace=robot.namespace,
            parameters=[written({f"/**/{name}": tree[name] for name in tree}, "ekf")],
            remappings=[("/tf", "tf"), ("/tf_static", "tf_static")],
            output="screen",
        )
    ]
