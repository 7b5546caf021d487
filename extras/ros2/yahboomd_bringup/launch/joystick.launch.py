"""Drives with a pad, as long as a button is held; its key has priority over a program's."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch_ros.actions import Node
from yahboomd_bringup.arguments import named_robot, shared_arguments, text
from yahboomd_bringup.parameters import written


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments."""
    return LaunchDescription(
        [
            *shared_arguments(),
            DeclareLaunchArgument(
                "enable_button", default_value="", description="number of the deadman button"
            ),
            DeclareLaunchArgument(
                "turbo_button", default_value="", description="number of the button for full speed"
            ),
            OpaqueFunction(function=_start),
        ]
    )


def _start(context):
    robot = named_robot(context)
    tree = robot.parameters("joystick")
    teleop = tree["teleop_twist_joy_node"]["ros__parameters"]
    for argument, parameter in (
        ("enable_button", "enable_button"),
        ("turbo_button", "enable_turbo_button"),
    ):
        if given := text(context, argument):
            teleop[parameter] = int(given)
    # The parameters name the nodes without a namespace.
    path = written({f"/**/{name}": values for name, values in tree.items()}, "joystick")
    shared = {"namespace": robot.namespace, "parameters": [path], "output": "screen"}
    return [
        Node(package="joy", executable="joy_node", name="joy_node", **shared),
        Node(
            package="teleop_twist_joy",
            executable="teleop_node",
            name="teleop_twist_joy_node",
            remappings=[("cmd_vel", robot.joystick_source)],
            **shared,
        ),
    ]
