"""Poses by samples: those in the frame of the odometry are set, all others refused and counted."""

from __future__ import annotations

from pathlib import Path

import pytest
from robot_bench import RobotBench

from yahboomd.bus import keys
from yahboomd.bus.subscriptions import Arrival
from yahboomd.daemon.pose_intake import PoseIntake
from yahboomd.messages.set_pose import pose_message
from yahboomd.simulation.virtual_time import on_virtual_time

HALF_TURN = (0.0, 0.0, 1.0, 0.0)
COVARIANCE = [0.0] * 36
COVARIANCE[0], COVARIANCE[35] = 0.25, 0.5


def arrival(payload: bytes) -> Arrival:
    return Arrival(key=keys.ODOMETRY_SET_POSE, payload=payload, stamp_ns=None, arrived_ns=0)


def pose(frame_id: str) -> Arrival:
    return arrival(pose_message(1, frame_id, (1.0, -2.0, 0.0, *HALF_TURN, *COVARIANCE)))


@on_virtual_time
async def test_odometry_goes_on_from_a_ros_pose_in_its_frame(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        intake = PoseIntake(bench.operator, "bot1/odom")
        # However often the bridge delivers it.
        intake.take([pose("bot1/odom")] * 32)
        count = len(bench.heard.estimates)
        await bench.until(lambda: len(bench.heard.estimates) > count + 2)
        estimate = bench.heard.estimates[-1]
        where = estimate.pose
        assert (where.x, where.y, where.theta) == pytest.approx((1.0, -2.0, 3.14159265), abs=1e-6)
        assert estimate.pose_covariance[0] == pytest.approx(0.25, abs=1e-3)
        assert estimate.pose_covariance[8] == pytest.approx(0.5, abs=1e-3)
        assert bench.controller.counters["poses_refused"] == 0


@on_virtual_time
async def test_a_native_sample_sets_the_pose_as_well(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        sample = b'{"x": 3.0, "y": 4.0, "theta": 0.5}'
        PoseIntake(bench.operator, "odom").take([arrival(sample)])
        count = len(bench.heard.estimates)
        await bench.until(lambda: len(bench.heard.estimates) > count + 2)
        where = bench.heard.estimates[-1].pose
        assert (where.x, where.y, where.theta) == pytest.approx((3.0, 4.0, 0.5))


@on_virtual_time
async def test_a_pose_in_another_frame_is_refused_counted_and_reported(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        before = bench.heard.estimates[-1].pose
        refused = [pose("map"), pose(""), arrival(b"\0\1\0\0odom"), arrival(b"{}"), arrival(b"")]
        PoseIntake(bench.operator, "odom").take(refused)
        count = len(bench.heard.estimates)
        await bench.until(lambda: len(bench.heard.estimates) > count + 2)
        assert bench.heard.estimates[-1].pose == before
        assert bench.controller.counters["poses_refused"] == 5
        events = [event for event in bench.heard.events if event.kind == "pose_refused"]
        assert 'its frame is "map", and a pose in "odom" is expected' in events[0].message
        assert "pose_set" not in bench.heard.kinds
