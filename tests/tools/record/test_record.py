"""`yahboomd record` beside a real daemon: nothing lost, killed without harm, refused in words."""

from __future__ import annotations

import argparse
import io
import json
import os
import signal
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, make_reader
from real_robot import RealRobot, wait_for
from rosbags.highlevel import AnyReader

from yahboomd.cli.main import main
from yahboomd.cli.record import size

pytestmark = pytest.mark.xdist_group("one_robot")


def start(robot: RealRobot, *arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "yahboomd", "record", *arguments, "--connect", robot.endpoint],
        text=True,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def drive(on_robot: Callable[..., int], *how: str) -> None:
    """Drive to the end; again, if a busy machine held the board up and the daemon stopped."""
    wait_for(lambda: on_robot("send", *how) == os.EX_OK, "it drives")


@pytest.mark.realtime
def test_a_recording_has_all_samples_and_other_readers_read_them(
    one_robot: RealRobot, on_robot: Callable[..., int], tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    process = start(one_robot, str(folder), "--json")
    wait_for(lambda: list(folder.glob("*.mcap")), "it records")
    drive(on_robot, "--vx", "0.2", "--wz", "0.5", "--for", "2")
    one_robot.settled_truth()
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    facts = json.loads(out)
    assert facts["lost"] == facts["unreadable"] == 0

    with (folder / "native_0.mcap").open("rb") as stream:
        native = [
            (channel.topic, json.loads(message.data))
            for _, channel, message in make_reader(stream).iter_messages()
        ]
    poses = [sample for topic, sample in native if topic == "yahboomd/pose"]
    assert len(poses) > 20
    # A burst has one time, by which readers sort.
    numbers = sorted(each["seq"] for each in poses)
    assert numbers == list(range(numbers[0], numbers[0] + len(poses)))
    assert any(topic == "cmd_vel" and sample.get("vx") == 0.2 for topic, sample in native)

    with AnyReader([folder]) as reader:
        odometry = [
            reader.deserialize(raw, connection.msgtype)
            for connection, _, raw in reader.messages()
            if connection.topic == "/odom"
        ]
        types = {connection.topic: connection.msgtype for connection in reader.connections}
    assert {"/odom", "/tf", "/joint_states", "/diagnostics", "/estopped"} <= set(types)
    assert odometry[-1].pose.pose.position.x == pytest.approx(poses[-1]["x"], abs=0.05)


@pytest.mark.nightly
@pytest.mark.realtime
def test_a_recorder_that_is_killed_leaves_what_it_has_written(
    one_robot: RealRobot, on_robot: Callable[..., int], tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    process = start(one_robot, str(folder))
    part, other = folder / "native_0.mcap", folder / "ros2_0.mcap"
    drive(on_robot, "--wz", "1", "--for", "1")
    for file in (part, other):
        wait_for(lambda f=file: f.exists() and f.stat().st_size > 20_000, "a chunk is written")
    process.kill()
    process.communicate()
    found = 0
    try:
        reader = NonSeekingReader(io.BytesIO(part.read_bytes()))
        for _ in reader.iter_messages(log_time_order=False):
            found += 1
    except (McapError, ValueError, EOFError, struct.error):
        pass
    assert found > 100
    one_robot.settled_truth()

    assert on_robot("record", str(folder), "--recover") == 0
    with (tmp_path / "run-recovered" / "native_0.mcap").open("rb") as stream:
        assert sum(1 for _ in make_reader(stream).iter_messages()) == found
    with AnyReader([tmp_path / "run-recovered"]) as reader:
        assert reader.message_count > 0
        assert sum(1 for _ in reader.messages()) == reader.message_count
    assert part.stat().st_size > 20_000
    # A recovered recording is not overwritten.
    assert on_robot("record", str(folder), "--recover") == 1


def test_what_is_no_recording_is_not_recovered(tmp_path: Path, capsys) -> None:
    assert main(["record", str(tmp_path), "--recover"]) == 1
    assert "has no recording" in capsys.readouterr().err
    assert main(["record", "--recover"]) == 2


@pytest.mark.parametrize(
    ("text", "expected"), [("500M", 500_000_000), ("2g", 2_000_000_000), ("1.5GB", 1_500_000_000)]
)
def test_sizes_are_read_as_people_write_them(text: str, expected: int) -> None:
    assert size(text) == expected


@pytest.mark.parametrize("text", ["", "lots", "-1M", "100k", "1.2.3M", "9" * 400])
def test_what_is_no_size_is_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="such as 500M"):
        size(text)
