"""Launches a file in ROS 2's own `launch`: `launched.py FILE [ARGUMENT:=VALUE ...]`.

Prints a JSON line for each process that starts, and one for the first error. It ends its processes
when its standard input ends. `launched.py --stand-in ...` is started in place of a node that is not
available: it prints its name, topics and parameters.
"""

import contextlib
import json
import sys
import threading

TOPICS = ("cmd_vel", "/tf", "/tf_static", "joint_states")


def say(**line):
    print(json.dumps(line), flush=True)


def stand_in(arguments):
    """A node that takes whatever parameters it is given, by ROS 2's own reader of their files."""
    import rclpy
    from rclpy.executors import ExternalShutdownException

    rclpy.init(args=[sys.argv[0], *arguments])
    node = rclpy.create_node("stand_in", automatically_declare_parameters_from_overrides=True)
    say(
        event="node",
        name=node.get_fully_qualified_name(),
        topics={name: node.resolve_topic_name(name) for name in TOPICS},
        parameters={
            name: parameter.value
            for name, parameter in node.get_parameters_by_prefix("").items()
            if name != "use_sim_time"
        },
    )
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)


def launched(path, arguments):
    from launch import LaunchDescription, LaunchService
    from launch.actions import IncludeLaunchDescription, RegisterEventHandler
    from launch.event_handlers import OnProcessIO, OnProcessStart
    from launch.launch_description_sources import PythonLaunchDescriptionSource

    def printed(event):
        for line in event.text.decode().splitlines():
            if line.startswith("{"):
                print(line, flush=True)

    file = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(path),
        launch_arguments=[each.split(":=", 1) for each in arguments],
    )
    handlers = [
        RegisterEventHandler(OnProcessStart(on_start=lambda e, _: say(event="start", cmd=e.cmd))),
        RegisterEventHandler(OnProcessIO(on_stdout=printed)),
    ]
    service = LaunchService(noninteractive=True)
    service.include_launch_description(LaunchDescription([*handlers, file]))

    def watch():
        sys.stdin.read()
        service.shutdown()

    threading.Thread(target=watch, daemon=True).start()
    say(event="ready")
    say(event="end", status=service.run())


if __name__ == "__main__":
    if sys.argv[1] == "--stand-in":
        stand_in(sys.argv[2:])
    else:
        launched(sys.argv[1], sys.argv[2:])
