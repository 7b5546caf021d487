"""A simulated board, the daemon and an application, each a process of its own."""

from __future__ import annotations

import json
import math
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from real_robot import Client, Process, RealRobot, free_endpoint, wait_for
from status_check import assert_registered

from benchmarks.soak.processes import DAEMON_NICE, prefer
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


@pytest.mark.parametrize("dialect", ["streamed", "polled"])
def test_each_encoding_moves_the_robot_and_the_pose_follows_the_truth(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client], dialect: str
) -> None:
    robot = real_robot(
        simulate=["--dialect", dialect, "--wheel-separation", str(SEPARATION_M)],
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
    status = app.latest("status")
    assert status["board"]["dialect"] == dialect
    assert status["command"]["accepted"] >= 3
    for each in app.samples["status"]:
        assert_registered(each, {"cmd_vel", "cmd_vel/moves", "cmd_vel/web", "cmd_vel/teleop"})
    assert robot.daemon.end() == 0
    assert robot.settled_truth().ticks == truth.ticks


@pytest.mark.parametrize("mode", ["client", "peer"])
def test_applications_on_the_same_machine_drive_and_listen(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client], mode: str
) -> None:
    robot = real_robot()
    app = client(mode, robot.endpoint)
    app.in_state("standing")
    app.drive_until(COMMANDS["json"], lambda: robot.travelled_m() > 0.1, "it drives")
    truth = robot.settled_truth()
    assert_at(app.pose_at(truth), truth)
    for key in ("pose", "twist", "wheels", "status"):
        newest = app.ask(f"yahboomd/{key}")
        assert newest["stamp_ns"] >= app.samples[key][0]["stamp_ns"]
    answer = app.ask("yahboomd/estop")
    assert answer["success"]
    assert app.in_state("estopped")["why"].startswith("Emergency stop")


@pytest.mark.parametrize("mode", ["client", "peer"])
def test_applications_reach_it_through_a_router_that_comes_later(
    real_robot: Callable[..., RealRobot],
    client: Callable[..., Client],
    zenoh_router: Any,
    mode: str,
) -> None:
    robot = real_robot(run=["--set", f'zenoh.connect=["{zenoh_router.endpoint}"]'])
    direct = client("client", robot.endpoint)
    direct.in_state("standing")
    zenoh_router.start()
    app = client(mode, zenoh_router.endpoint)
    app.in_state("standing")
    wait_for(lambda: direct.latest("status")["bus"]["routers"], "the router in status")
    app.drive_until(COMMANDS["json"], lambda: robot.travelled_m() > 0.1, "it drives")
    truth = robot.settled_truth()
    assert_at(app.pose_at(truth), truth)
    wait_for(
        lambda: "router_joined" in [each["kind"] for each in direct.samples.get("events", ())],
        "an event",
    )


def test_the_example_drives_the_robot_and_reads_its_pose(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client]
) -> None:
    robot = real_robot()
    app = client("client", robot.endpoint)
    app.in_state("standing")
    example = Path(__file__).parent.parent / "examples" / "drive_in_a_circle.py"
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


def test_the_example_says_in_a_sentence_why_the_robot_will_not_move(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client]
) -> None:
    robot = real_robot()
    app = client("client", robot.endpoint)
    app.in_state("standing")
    assert app.ask("yahboomd/estop")["success"]
    example = Path(__file__).parent.parent / "examples" / "drive_in_a_circle.py"
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


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (["--set", "chassis.wheel_separation_m=-1"], 78, "chassis.wheel_separation_m"),
        (["--set", 'zenoh.listen=["tcp/nowhere"]'], 78, "zenoh.listen"),
        (["--config", "/nonexistent.toml"], 78, "/nonexistent.toml"),
    ],
)
def test_a_mistake_of_the_user_ends_in_a_sentence_and_a_status(
    arguments: list[str], status: int, words: str
) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "yahboomd", "run", *arguments],
        capture_output=True,
        check=False,
        text=True,
        timeout=PATIENCE_S,
    )
    assert done.returncode == status
    assert words in done.stderr
    assert "Traceback" not in done.stderr


def test_a_listening_port_that_is_taken_is_named(
    real_robot: Callable[..., RealRobot],
) -> None:
    robot = real_robot()
    robot.daemon.says("Connected")
    second = robot.start_daemon()
    status = second.process.wait(PATIENCE_S)
    assert status == 69
    second.end()
    assert robot.endpoint.rsplit(":", 1)[-1] in second.output
    assert "Traceback" not in second.output


def test_a_port_that_is_missing_is_waited_for_and_named(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client]
) -> None:
    robot = real_robot(port="/dev/not-there")
    app = client("client", robot.endpoint)
    status = app.in_state("waiting")
    wait_for(lambda: "/dev/not-there" in app.latest("status")["why"], "the port in the reason")
    assert status["driver"] is None
    robot.daemon.says("/dev/not-there: there is no such port.")
    assert robot.daemon.output.count("/dev/not-there") == 1


def test_a_port_that_is_busy_names_its_holder(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client]
) -> None:
    robot = real_robot()
    robot.daemon.says("Connected")
    first = robot.daemon
    robot.endpoint = "tcp/127.0.0.1:0"
    try:
        second = robot.start_daemon()
        second.says(f"(pid {first.process.pid})")
        second.end()
    finally:
        first.end()


def test_garbage_on_the_port_is_counted_and_raises_nothing(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client]
) -> None:
    robot = real_robot()
    app = client("client", robot.endpoint)
    app.in_state("standing")
    assert robot.do("babble 0.3").startswith("ok")

    def seen() -> bool:
        link = app.latest("status")["link"]
        return bool(link["discarded_bytes"] + link["bad_bytes"] > 100)

    wait_for(seen, "garbage counted")
    app.in_state("standing")

    def unknown() -> int:
        events = app.samples.get("events", ())
        return sum(event["kind"] == "odometry_discontinuity" for event in events)

    while True:
        begin = robot.settled_truth()
        before, known = app.pose_at(begin), unknown()
        app.drive(COMMANDS["json"], 0.5)
        end = robot.settled_truth()
        after = app.pose_at(end)
        # A daemon without a processor reports the unknown travel.
        if unknown() == known:
            break
    moved_m = math.hypot(after["x"] - before["x"], after["y"] - before["y"])
    assert moved_m == pytest.approx(math.hypot(end.x - begin.x, end.y - begin.y), abs=0.008)
    turned = after["theta"] - before["theta"]
    assert turned == pytest.approx(end.theta - begin.theta, abs=3 * TICK_M / SEPARATION_M)
    assert "Traceback" not in robot.daemon.output


def test_refused_commands_are_visible_in_status(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client]
) -> None:
    robot = real_robot()
    app = client("client", robot.endpoint)
    app.in_state("standing")

    def counted() -> bool:
        # Again and again: a busy network may drop a sample.
        for payload in (b"garbage", b'{"vx": 1e999}', b'{"hello": 1}', b"{" * 100_000):
            app.session.put("cmd_vel", payload)
        time.sleep(0.1)
        command = app.latest("status")["command"]
        wanted = ("unknown_encoding", "not_finite", "no_velocity", "oversize")
        return all(command.get(reason, 0) >= 1 for reason in wanted)

    wait_for(counted, "every refusal counted")
    assert sum(robot.truth()[-1].travel_m) == pytest.approx(0.0, abs=1e-6)
