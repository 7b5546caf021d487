"""What is written of what arrives, and what is counted as lost."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from yahboomd.core.bus.subscriptions import Arrival
from yahboomd.core.messages.native import PoseSample, VelocityCommand
from yahboomd.tools.record.bus_recorder import TopicRecorder
from yahboomd.tools.record.mcap_files import McapFiles
from yahboomd.tools.record.recorded_topics import Recorded


def arrival(payload: bytes, dropped: int = 0, arrived_ns: int = 0) -> Arrival:
    return Arrival(
        key="yahboomd/pose",
        payload=payload,
        stamp_ns=None,
        arrived_ns=arrived_ns,
        dropped=dropped,
    )


def test_samples_whose_moments_are_out_of_order_are_recorded_as_they_came(tmp_path: Path) -> None:
    native, ros = McapFiles(tmp_path, "native"), McapFiles(tmp_path, "ros2", is_bag=True)
    recorder = TopicRecorder(native, ros, lambda at_ns: at_ns + 1000)
    topic = Recorded("yahboomd/pose", "yahboomd/pose", message=PoseSample)
    moments = enumerate((10, 30, 20, 40))
    recorder.take(topic, [arrival(b'{"seq": %d}' % n, arrived_ns=at) for n, at in moments])
    recorder.end()
    with (tmp_path / "native_0.mcap").open("rb") as stream:
        found = [
            (message.sequence, message.log_time)
            for _, _, message in make_reader(stream).iter_messages()
        ]
    assert found == [(0, 1010), (1, 1030), (2, 1030), (3, 1040)]


def test_a_gap_in_the_numbers_is_counted_as_lost_and_a_new_daemon_is_not(tmp_path: Path) -> None:
    native, ros = McapFiles(tmp_path, "native"), McapFiles(tmp_path, "ros2", is_bag=True)
    recorder = TopicRecorder(native, ros, lambda at_ns: at_ns + 1)
    topic = Recorded("yahboomd/pose", "yahboomd/pose", message=PoseSample)
    recorder.take(topic, [arrival(b'{"seq": %d}' % number) for number in (5, 6, 9, 1, 2)])
    recorder.take(topic, [arrival(b"no message")])
    facts = recorder.end()
    assert (facts["messages"], facts["lost"], facts["unreadable"]) == (5, 2, 1)


@pytest.mark.parametrize(
    "payload",
    [
        b'{"seq": ',
        b'{"seq": "x"}',
        b'{"seq": -1}',
        b'{"seq": 4294967296}',
        b'{"x": ' + b"[" * 100_000,
        b"\x81\xa1x" + b"\x91" * 100_000,
    ],
)
def test_what_another_client_publishes_costs_no_other_sample(
    tmp_path: Path, payload: bytes
) -> None:
    native, ros = McapFiles(tmp_path, "native"), McapFiles(tmp_path, "ros2", is_bag=True)
    recorder = TopicRecorder(native, ros, lambda at_ns: at_ns + 1)
    topic = Recorded("cmd_vel", "cmd_vel", message=VelocityCommand)
    recorder.take(topic, [arrival(payload), arrival(b'{"vx": 0.1}')])
    facts = recorder.end()
    assert (facts["messages"], facts["unreadable"]) == (1, 1)


@pytest.mark.parametrize("lost", ["disk", "folder"])
def test_a_disk_that_is_full_or_lost_at_the_end_is_named_and_spares_the_other_files(
    tmp_path: Path, lost: str
) -> None:
    native, ros = McapFiles(tmp_path, "native"), McapFiles(tmp_path, "ros2", is_bag=True)
    recorder = TopicRecorder(native, ros, lambda at_ns: at_ns + 1)
    poses = Recorded("yahboomd/pose", "yahboomd/pose", message=PoseSample)
    stopped = Recorded("estopped", "/estopped", ros_type="std_msgs/msg/Bool")
    recorder.take(poses, [arrival(b'{"seq": 1}')])
    recorder.take(stopped, [arrival(b"\0\1\0\0\1\0\0\0")])
    if lost == "disk":
        full = os.open("/dev/full", os.O_WRONLY)
        os.dup2(full, native._stream._fd)
        os.close(full)
    else:
        shutil.rmtree(tmp_path)
    facts = recorder.end()
    assert facts["messages"] == 2
    assert recorder.problem.startswith("The recording ends: No s")
    if lost == "disk":
        with AnyReader([tmp_path]) as reader:
            assert reader.message_count == 1
