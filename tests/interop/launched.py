"""Launches a file in ROS 2's own `launch`: `launched.py FILE [ARGUMENT:=VALUE ...]`.

Prints a JSON line for each process that starts, and those that its processes print. What `launch`
says itself goes to standard error. It ends its processes when its standard input ends.
"""

import json
import os
import sys
import threading

LINES = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)


def say(**line):
    print(json.dumps(line), file=LINES, flush=True)


def launched(path, arguments):
    from launch import LaunchDescription, LaunchService
    from launch.actions import IncludeLaunchDescription, RegisterEventHandler
    from launch.event_handlers import OnProcessIO, OnProcessStart
    from launch.launch_description_sources import PythonLaunchDescriptionSource

    def printed(event):
        for line in event.text.decode().splitlines():
            if line.startswith("{"):
                print(line, file=LINES, flush=True)

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
    launched(sys.argv[1], sys.argv[2:])
