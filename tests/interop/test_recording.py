"""The files of `yahboomd record`, as ROS 2 itself deserialises them."""

from __future__ import annotations

import base64
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from mcap.reader import make_reader
from real_robot import RealRobot, wait_for
from ros_peers import CACHE, DISTROS, built

pytestmark = [pytest.mark.realtime, pytest.mark.nightly]

DESERIALISE = """
import base64, importlib, json, sys
from rclpy.serialization import deserialize_message
for line in sys.stdin:
    topic, ros_type, payload = json.loads(line)
    package, _, name = ros_type.split("/")
    kind = getattr(importlib.import_module(package + ".msg"), name)
    message = deserialize_message(base64.b64decode(payload), kind)
    print(json.dumps([topic, getattr(message, "child_frame_id", "")]))
"""


def record(robot: RealRobot, folder: Path) -> None:
    """A recording of a robot that drove."""
    at = ("--connect", robot.endpoint)
    process = subprocess.Popen([sys.executable, "-m", "yahboomd", "record", str(folder), *at])
    try:
        wait_for(lambda: list(folder.glob("ros2*.mcap")), "it records")
        drive = ["send", "--vx", "0.3", "--wz", "0.3", "--for", "2", *at]
        command = [sys.executable, "-m", "yahboomd", *drive]
        # Repeated, in case a busy machine held the board up and the daemon stopped.
        wait_for(lambda: subprocess.call(command) == os.EX_OK, "it drives")
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 0


def test_rclpy_deserialises_every_topic_of_a_recording(
    real_robot: Callable[..., RealRobot], tmp_path: Path
) -> None:
    pythons = {distro: built(f"ros-{distro}") for distro in DISTROS}
    robot = real_robot(run=["--set", "board.battery_period_s=1"])
    robot.daemon.says("Connected to")
    record(robot, tmp_path / "run")
    lines, topics = [], set()
    with (tmp_path / "run" / "ros2_0.mcap").open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            topics.add(channel.topic)
            payload = base64.b64encode(message.data).decode()
            lines.append(json.dumps([channel.topic, schema.name, payload]))
    assert {
        "/odom",
        "/tf",
        "/joint_states",
        "/battery_state",
        "/diagnostics",
        "/estopped",
    } <= topics
    for distro, python in pythons.items():
        done = subprocess.run(
            [python, "-c", DESERIALISE],
            input="\n".join(lines),
            env={**os.environ, "AMENT_PREFIX_PATH": str(CACHE / f"ros-{distro}")},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr[-2000:]
        read = [json.loads(line) for line in done.stdout.splitlines()]
        assert {topic for topic, _ in read} == topics
        assert len(read) == len(lines)
        assert ["/odom", "base_link"] in read
