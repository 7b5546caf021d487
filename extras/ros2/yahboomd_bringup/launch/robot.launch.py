"""The robot itself: the way into ROS 2, the model, and yahboomd where no service runs it."""

import os
import shutil

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, LogInfo, OpaqueFunction
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from yahboomd_bringup.arguments import is_true, named_robot, shared_arguments, text
from yahboomd_bringup.robot import BringupError, Robot

BRIDGE = "zenoh-bridge-ros2dds"


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments; what is started depends on the configuration."""
    return LaunchDescription(
        [
            *shared_arguments(),
            DeclareLaunchArgument(
                "way",
                default_value="auto",
                choices=["auto", "bridge", "native", "none"],
                description="into ROS 2; auto: as configured; none: the bridge runs elsewhere",
            ),
            DeclareLaunchArgument(
                "bridge_config",
                default_value="/etc/yahboomd/zenoh-bridge-ros2dds.json5",
                description="a copy of examples/zenoh-bridge-ros2dds.json5",
            ),
            DeclareLaunchArgument(
                "run_yahboomd",
                default_value="false",
                description="start the daemon here; false where its service does",
            ),
            OpaqueFunction(function=_start),
        ]
    )


def _start(context):
    robot = named_robot(context)
    actions = _way(context, robot)
    if is_true(context, "run_yahboomd"):
        actions.append(
            # It stops the wheels when it is ended; give it the time that this may take.
            ExecuteProcess(
                cmd=[robot.command, "run", *robot.options],
                name="yahboomd",
                output="screen",
                sigterm_timeout="10",
            )
        )
    actions.append(
        Node(
            package="robot_state_publisher",
            executable="robot_state_publisher",
            namespace=robot.namespace,
            parameters=[
                {
                    "robot_description": ParameterValue(robot.urdf(), value_type=str),
                    "frame_prefix": robot.facts["ros2"]["frame_prefix"],
                }
            ],
            remappings=[
                ("/tf", "tf"),
                ("/tf_static", "tf_static"),
                ("joint_states", robot.facts["ros2"]["joint_states_topic"]),
            ],
            output="screen",
        )
    )
    return actions


def _way(context, robot: Robot) -> list:
    ros2, way = robot.facts["ros2"], text(context, "way")
    if way == "auto":
        way = "bridge" if ros2["bridge"] else "native"
    if way == "none":
        return []
    key = "bridge" if way == "bridge" else "rmw_zenoh"
    if not ros2[key]:
        raise BringupError(f"way:={way} needs {key} = true under [ros2] in yahboomd's file.")
    if way == "native":
        used = os.environ.get("RMW_IMPLEMENTATION", "")
        if used != "rmw_zenoh_cpp":
            raise BringupError(
                f"way:=native needs RMW_IMPLEMENTATION=rmw_zenoh_cpp, and it is {used or 'unset'}. "
                "Export it before `ros2 launch`; for DDS take way:=bridge."
            )
        return [LogInfo(msg="ROS 2 reaches yahboomd over rmw_zenoh.")]
    path = text(context, "bridge_config")
    if not os.path.exists(path):
        raise BringupError(
            f"There is no {path}. Copy examples/zenoh-bridge-ros2dds.json5 there, or name it: "
            "bridge_config:=/path/to/it."
        )
    if not shutil.which(BRIDGE):
        raise BringupError(
            f"There is no {BRIDGE} on the PATH. Install it from the releases of "
            "zenoh-plugin-ros2dds; way:=none where it runs elsewhere, way:=native without it."
        )
    return [
        ExecuteProcess(
            cmd=[BRIDGE, "-c", path],
            name="zenoh_bridge_ros2dds",
            additional_env={"ROS_DISTRO": ros2["distro"]},
            output="screen",
        ),
        Node(
            package="yahboomd_bringup",
            executable="resident",
            namespace=robot.namespace,
            arguments=["--yahboomd", robot.command, *robot.options],
            # Each of its lives has a name of its own.
            respawn=True,
            output="screen",
        ),
    ]
