"""A port that hangs up, vanishes, returns elsewhere, or takes nothing: on a real pty."""

from __future__ import annotations

import itertools
import math
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from real_robot import Client, RealRobot, wait_for

pytestmark = pytest.mark.realtime

DRIVE = b'{"vx": 0.3}'
SPEED_MAX_M_S = 2.0
TICK_M = math.pi * 0.067 / 1320

FAR = "10000000,0,10000000,0"
"""Counters of a board that has been driven for 1.6 km: no reset could have led back to them."""

UNHURRIED = ("--set", "command.timeout_s=3")
"""For tests in which the wheels must turn until this process does the next thing, even late."""


@pytest.fixture
def robot(real_robot: Callable[..., RealRobot]) -> RealRobot:
    return real_robot(simulate=["--wheel-separation", "0.15", "--ticks", FAR])


@pytest.fixture
def young(request: pytest.FixtureRequest, real_robot: Callable[..., RealRobot]) -> RealRobot:
    """A board whose counters are so near to zero that they prove nothing about a reset."""
    return real_robot(
        simulate=["--wheel-separation", "0.15", "--dialect", request.param], run=UNHURRIED
    )


@pytest.fixture
def app(robot: RealRobot, client: Callable[..., Client]) -> Client:
    app = client("client", robot.endpoint)
    app.in_state("standing")
    return app


def drives(app: Client, robot: RealRobot) -> None:
    """Drive until the wheels turn, and have gone a part of a metre."""
    enough_m = robot.travelled_m() + 0.4

    def found() -> bool:
        return robot.travelled_m() > enough_m and min(robot.truth()[-1].speed_m_s) > 0.2

    app.drive_until(DRIVE, found, "it drives")


def cpu_s(pid: int) -> float:
    """Processor time that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


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


def since_unplugged(app: Client, kind: str) -> dict[str, Any]:
    """The first event of a kind since the port went away: a busy machine may have had gaps before.

    Args:
        kind: How it begins.
    """

    def found() -> dict[str, Any] | None:
        events = iter(app.samples.get("events", []))
        any(event["kind"] == "disconnected" for event in events)
        return next((event for event in events if event["kind"].startswith(kind)), None)

    event: dict[str, Any] = wait_for(found, f"an event {kind}")
    return event


def test_an_unplugged_board_is_found_again_on_another_device_and_nothing_is_lost(
    robot: RealRobot, app: Client
) -> None:
    pid = robot.daemon.process.pid
    for _ in range(2):
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
    assert robot.daemon.process.pid == pid
    assert robot.daemon.process.poll() is None
    assert_no_jump(app.samples["pose"])
    kinds = [event["kind"] for event in app.samples["events"]]
    assert kinds.count("disconnected") == 2
    assert "odometry_discontinuity" not in kinds
    app.drive(DRIVE, 0.5)
    assert_at_truth(app, robot)


@pytest.mark.parametrize("young", ["streamed"], indirect=True)
def test_a_stream_that_ran_on_while_the_plug_was_out_keeps_the_pose_near_zero_too(
    young: RealRobot, client: Callable[..., Client]
) -> None:
    app = client("client", young.endpoint)
    app.in_state("standing")
    drives(app, young)
    assert young.do("unplug 1").startswith("ok")
    app.passes("waiting")
    app.in_state("standing")
    assert_at_truth(app, young)
    event = since_unplugged(app, "odometry_")
    assert (event["kind"], event["data"]["cause"]) == ("odometry_bridged", "gap_kept")
    assert_no_jump(app.samples["pose"])


def test_a_board_that_stays_away_costs_next_to_no_processor(robot: RealRobot, app: Client) -> None:
    robot.do("unplug")
    app.in_state("waiting")
    pid = robot.daemon.process.pid
    used_s, began_s = cpu_s(pid), time.monotonic()
    time.sleep(3.0)
    share = (cpu_s(pid) - used_s) / (time.monotonic() - began_s)
    attempts = app.latest("status")["link"]["attempts"]
    print(f"unplugged: {share * 100:.1f} % of a core, {attempts} attempts")
    # A loop that spins takes a whole one.
    assert share < 0.5
    robot.do("replug")
    app.in_state("standing")
    app.drive(DRIVE, 0.5)
    assert_at_truth(app, robot)


@pytest.mark.parametrize("fault", ["mute 3", "babble 3", "brown-out 0.3", "reset"])
def test_a_board_in_trouble_stands_and_drives_again_afterwards(
    robot: RealRobot, app: Client, fault: str
) -> None:
    app.drive(DRIVE, 1.0)
    robot.do(fault)
    wait_for(robot.stands, "the wheels stand")
    app.in_state("standing")
    drives(app, robot)
    assert_no_jump(app.samples["pose"])
    assert "Traceback" not in robot.daemon.output


def test_a_board_that_hangs_is_named_and_drives_after_its_reset(
    robot: RealRobot, app: Client
) -> None:
    app.drive(DRIVE, 0.5)
    robot.do("hang")
    wait_for(lambda: "no board answers" in app.latest("status")["why"], "its silence is named")
    robot.do("reset")
    app.in_state("standing")
    robot.settled_truth()
    drives(app, robot)


def test_noise_on_the_line_raises_nothing(robot: RealRobot, app: Client) -> None:
    app.drive(DRIVE, 0.5)
    robot.do("loss 0.2")
    app.drive(DRIVE, 2.0)
    robot.do("clear")
    app.ask("yahboomd/estop")
    wait_for(lambda: app.ask("yahboomd/estop/reset")["success"], "released")
    app.in_state("standing")
    robot.settled_truth()
    app.drive(DRIVE, 1.0)
    assert "Traceback" not in robot.daemon.output
    assert_no_jump(app.samples["pose"])


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
        for _ in range(30):
            app.session.put("cmd_vel", DRIVE)
            time.sleep(0.05)
        # The kernel may take the stop, or the connection may be about to be given up.
        answer = app.ask("yahboomd/estop")
        assert answer["success"] or "It could not be sent, because" in answer["message"]
        began_s = time.monotonic()
        assert robot.daemon.end() == os.EX_TEMPFAIL
        print(f"ended {time.monotonic() - began_s:.1f} s after SIGTERM, with the port stuck")
    finally:
        robot.simulation.process.send_signal(signal.SIGCONT)
    assert "Traceback" not in robot.daemon.output


def test_no_descriptor_is_left_behind_by_reconnecting(robot: RealRobot, app: Client) -> None:
    def descriptors() -> int:
        return len(os.listdir(f"/proc/{robot.daemon.process.pid}/fd"))

    app.latest("battery")
    before = descriptors()
    for _ in range(6):
        robot.do("unplug 0.1")
        app.passes("waiting")
        app.in_state("standing")
    wait_for(lambda: descriptors() <= before + 1, "descriptors are given back")
