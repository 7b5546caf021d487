"""A port that hangs up, returns elsewhere, or takes nothing: on a real pty."""

from __future__ import annotations

import itertools
import math
import os
import signal
import time
from collections.abc import Callable
from typing import Any

import pytest
from fault_bench import SPEED_MAX_M_S, TICK_M
from real_robot import Client, RealRobot, wait_for

pytestmark = pytest.mark.realtime

DRIVE = b'{"vx": 0.3}'

FAR = "10000000,0,10000000,0"
"""Counters of a board that has been driven for 1.6 km: no reset could have led back to them."""

UNHURRIED = ("--set", "command.timeout_s=3")
"""For tests in which the wheels must turn until this process does the next thing, even late."""


def drives(app: Client, robot: RealRobot) -> None:
    """Drive until the wheels turn, and have gone a part of a metre."""
    enough_m = robot.travelled_m() + 0.2
    app.drive_until(
        DRIVE,
        lambda: robot.travelled_m() > enough_m and min(robot.truth()[-1].speed_m_s) > 0.2,
        "it drives",
    )


def assert_at_truth(app: Client, robot: RealRobot) -> None:
    """The published pose is the robot's true one."""
    truth = robot.settled_truth()
    pose = app.pose_at(truth)
    assert math.hypot(pose["x"] - truth.x, pose["y"] - truth.y) < 0.008


def assert_no_jump(poses: list[dict[str, Any]]) -> None:
    """No published step is longer than the wheels can roll in its time."""
    for before, after in itertools.pairwise(poses):
        room_m = SPEED_MAX_M_S * (after["stamp_ns"] - before["stamp_ns"]) / 1e9 + TICK_M
        assert math.hypot(after["x"] - before["x"], after["y"] - before["y"]) <= 1.05 * room_m
        assert after["covariance"][8] >= before["covariance"][8]


@pytest.mark.parametrize(
    "dialect", ["streamed", pytest.param("rosmaster", marks=pytest.mark.nightly)]
)
def test_an_unplugged_board_is_found_again_on_another_device_and_nothing_is_lost(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client], dialect: str
) -> None:
    robot = real_robot(simulate=["--dialect", dialect, "--ticks", FAR, "--start-up", "0.5"])
    app = client("client", robot.endpoint)
    app.in_state("standing")
    app.latest("battery")
    pid = robot.daemon.process.pid

    def descriptors() -> int:
        return len(os.listdir(f"/proc/{pid}/fd"))

    before = descriptors()
    device = os.readlink(robot.port)
    # Before the simulation has let go of it, the kernel would give the same number again.
    held = os.open(device, os.O_RDWR | os.O_NOCTTY)
    app.drive(DRIVE, 0.3)
    assert robot.do("unplug 1").startswith("ok")
    app.passes("waiting")
    robot.daemon.says("the port went away")
    app.in_state("standing")
    assert os.readlink(robot.port) != device
    os.close(held)
    assert_at_truth(app, robot)
    wait_for(lambda: descriptors() <= before + 1, "descriptors are given back")
    assert robot.daemon.process.poll() is None
    assert_no_jump(app.samples["pose"])
    kinds = [event["kind"] for event in app.samples["events"]]
    # A starved board is silent, and its port is opened again, too.
    assert kinds.count("disconnected") == 1 + robot.daemon.output.count("the board sent no counts")
    assert "odometry_discontinuity" not in kinds
    drives(app, robot)
    assert_at_truth(app, robot)


def test_a_port_that_takes_nothing_keeps_the_daemon_neither_from_its_work_nor_from_ending(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client]
) -> None:
    """The other end is frozen: the kernel's buffer fills, and nothing comes."""
    robot = real_robot(run=UNHURRIED)
    app = client("client", robot.endpoint)
    app.in_state("standing")
    drives(app, robot)
    robot.simulation.process.send_signal(signal.SIGSTOP)
    try:
        status = app.in_state("waiting")
        assert "counts" in status["why"] or "no board answers" in status["why"]
        # It goes on talking into the void, until the void is full.
        app.drive(DRIVE, 1.5)
        # The kernel may take the stop, or the connection may be about to be given up.
        answer = app.ask("yahboomd/estop")
        assert answer["success"] or "It could not be sent, because" in answer["message"]
        began_s = time.monotonic()
        assert robot.daemon.end() == os.EX_TEMPFAIL
        print(f"ended {time.monotonic() - began_s:.1f} s after SIGTERM, with the port stuck")
    finally:
        robot.simulation.process.send_signal(signal.SIGCONT)
    assert "Traceback" not in robot.daemon.output
