"""A simulated board, the daemon and an application, each a process of its own."""

from __future__ import annotations

import json
import math
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from process_priority import DAEMON_NICE, prefer
from real_robot import Client, Process, RealRobot, free_endpoint
from status_check import assert_registered

from yahboomd.simulation.truth import TruthSample

pytestmark = pytest.mark.realtime

SEPARATION_M = 0.15
TICK_M = math.pi * 0.067 / 1320
PATIENCE_S = 300.0
"""Only a program that hangs takes this long."""

CDR_TWIST = b"\x00\x01\x00\x00" + struct.pack("<6d", 0.25, 0.0, 0.0, 0.0, 0.0, 0.6)
COMMANDS = {
    "json": json.dumps({"vx": 0.25, "wz": 0.6}).encode(),
    "msgpack": msgspec.msgpack.encode({"vx": 0.25, "wz": 0.6}),
    "cdr": CDR_TWIST,
}


def assert_at(pose: dict[str, Any], truth: TruthSample) -> None:
    """The pose is the truth, up to the encoders' resolution."""
    assert math.hypot(pose["x"] - truth.x, pose["y"] - truth.y) < 0.008
    assert abs(pose["theta"] - truth.theta) <= 2 * TICK_M / SEPARATION_M


def farthest_from_path(app: Client, path: list[TruthSample]) -> float:
    """The largest distance of any published pose from the path that was truly driven, in metres."""
    return max(
        min(math.hypot(pose["x"] - t.x, pose["y"] - t.y) for t in path)
        for pose in app.samples["pose"]
    )


@pytest.mark.parametrize("dialect", ["streamed", pytest.param("polled", marks=pytest.mark.nightly)])
def test_each_encoding_moves_the_robot_and_the_pose_follows_the_truth(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client], dialect: str
) -> None:
    robot = real_robot(
        # So far from zero no silence of a starved board can hide a reset, and its travel is kept.
        simulate=[
            *("--dialect", dialect, "--ticks", "3000000,0,3000000,0"),
            *("--wheel-separation", str(SEPARATION_M)),
        ],
        run=["--set", "command.timeout_s=2.0"],
    )
    app = client("client", robot.endpoint)
    app.in_state("standing")
    travelled = 0.0
    for payload in COMMANDS.values():
        goal_m = travelled + 0.3
        app.drive_until(payload, lambda goal_m=goal_m: robot.travelled_m() > goal_m, "it drives")
        truth = robot.settled_truth()
        travelled = sum(truth.travel_m)
        assert_at(app.pose_at(truth), truth)
    assert farthest_from_path(app, robot.truth()) < 0.008
    for key in ("pose", "twist", "wheels", "status"):
        assert app.ask(f"yahboomd/{key}")["stamp_ns"] >= app.samples[key][0]["stamp_ns"]
    status = app.latest("status")
    assert status["board"]["dialect"] == dialect
    assert status["command"]["accepted"] >= 3
    for each in app.samples["status"]:
        assert_registered(each, {"cmd_vel", "cmd_vel/moves", "cmd_vel/web", "cmd_vel/teleop"})
    # A starved board sends no counts that show standing wheels, and the daemon says so.
    assert robot.daemon.end() == 0 or "did not see the wheels stand" in robot.daemon.output
    assert robot.settled_truth().ticks == truth.ticks


@pytest.mark.nightly
def test_the_example_drives_the_robot_and_reads_its_pose(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client]
) -> None:
    robot = real_robot()
    app = client("client", robot.endpoint)
    app.in_state("standing")
    example = Path(__file__).parents[2] / "examples" / "drive_in_a_circle.py"
    moves = Process("moves", "--connect", robot.endpoint)
    prefer(moves.process, DAEMON_NICE)
    moves.says("Moves are served")
    for _ in range(20):
        done = subprocess.run(
            [sys.executable, str(example), robot.endpoint],
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
        # A busy machine may starve a process for as long as ends a move: it is asked for again.
        if done.returncode == 0:
            break
    moves.end()
    assert done.returncode == 0, done.stderr
    robot.settled_truth()
    last = done.stdout.rstrip().splitlines()[-1].split("\r")[-1].split()
    x, y, theta = float(last[1]), float(last[4]), float(last[7])
    # How close to the end the last one is that it prints depends on the machine.
    assert any(
        math.hypot(x - t.x, y - t.y) < 0.01 and abs(theta - t.theta) < 0.01 for t in robot.truth()
    )
    assert theta > 1.0


@pytest.mark.nightly
def test_the_example_says_in_a_sentence_why_the_robot_will_not_move(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client]
) -> None:
    robot = real_robot()
    app = client("client", robot.endpoint)
    app.in_state("standing")
    assert app.ask("yahboomd/estop")["success"]
    example = Path(__file__).parents[2] / "examples" / "drive_in_a_circle.py"
    for endpoint, words in (
        (robot.endpoint, "The robot will not move. Emergency stop"),
        (free_endpoint(), "No yahboomd answers at"),
    ):
        done = subprocess.run(
            [sys.executable, str(example), endpoint],
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
        assert done.returncode == 1
        assert done.stderr.startswith(words)
        assert "Traceback" not in done.stderr
