"""Every example drives a real daemon on a simulated board, and stops it in every way."""

from __future__ import annotations

import json
import math
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from fake_robot import FakeRobot
from real_robot import Client, RealRobot, wait_for

pytestmark = pytest.mark.realtime
square = pytest.mark.commands("square")

SIDE_M = 0.3
WILL_NOT_MOVE = 75
ROOT = Path(__file__).resolve().parents[2]
COMMAND = json.loads((ROOT / "schemas" / "VelocityCommand.json").read_text())


def last_line(out: str) -> dict[str, Any]:
    values: dict[str, Any] = json.loads(out.splitlines()[-1])
    return values


def moved_m(robot: RealRobot) -> float:
    return robot.travelled_m() / 2


@pytest.fixture
def robot(real_robot: Callable[..., RealRobot]) -> RealRobot:
    """A robot that has a board."""
    # A simulated board that gets no processor time for a moment looks like one without supply.
    made = real_robot(run=["--set", "faults.stall=report"])
    made.daemon.says("Connected")
    return made


def assert_square(
    robot: RealRobot, out: str, *, unseen_m: float = 0.1, unseen_rad: float = 0.2
) -> None:
    """The true path was a square of that side, and ended near the program's own pose.

    A program that a busy machine delays drives past a corner, until its own deadman stops it:
    at most 0.25 m/s for 0.5 s.
    """
    tolerance_m = 0.15
    truth = robot.settled_truth()
    if "Counts were missing" in robot.daemon.output:
        # The machine stood still for about a second, and the robot drove on.
        tolerance_m, unseen_m, unseen_rad = 0.45, 0.45, 1.0
    believed = last_line(out)
    for pose in ((believed["x"], believed["y"]), (truth.x, truth.y)):
        assert math.hypot(*pose) < tolerance_m, pose
    believed_at = (believed["x"], believed["y"])
    assert math.dist(believed_at, (truth.x, truth.y)) < unseen_m, (believed, truth)
    assert truth.theta == pytest.approx(math.tau, abs=unseen_rad + 0.2)
    assert math.remainder(believed["theta"] - truth.theta, math.tau) == pytest.approx(
        0.0, abs=unseen_rad + 0.1
    )
    path = [(each.x, each.y) for each in robot.truth()]
    for corner in ((SIDE_M, 0.0), (SIDE_M, SIDE_M), (0.0, SIDE_M)):
        assert min(math.dist(place, corner) for place in path) < tolerance_m, corner
    for x, y in path:
        outside = max(abs(x - SIDE_M / 2), abs(y - SIDE_M / 2)) - SIDE_M / 2
        assert abs(outside) < tolerance_m, (x, y)


@square
def test_a_square_is_driven_and_closed(program: Any, robot: RealRobot) -> None:
    done = program.run("square", str(SIDE_M), robot=robot.endpoint)
    assert done.code == 0, done
    assert_square(robot, done.out)


def test_the_short_program_of_the_page_of_clients_drives_an_arc_and_prints_poses(
    program: Any, robot: RealRobot
) -> None:
    done = program.run_arc(robot.endpoint)
    assert done.code == 0, done
    assert "theta" in done.out
    truth = robot.settled_truth()
    # 0.2 m/s and 0.5 rad/s, for 2 s and as long as this machine delays the commands.
    assert 0.5 < truth.theta < 2.5
    end = (0.4 * math.sin(truth.theta), 0.4 * (1.0 - math.cos(truth.theta)))
    assert math.dist((truth.x, truth.y), end) < 0.1, truth
    page = (ROOT / "docs" / "clients.md").read_text()
    assert program.built.arc_source.read_text() in page


@square
@pytest.mark.nightly
def test_a_restart_of_the_daemon_in_mid_square_is_survived(program: Any, robot: RealRobot) -> None:
    running = program.start("square", str(SIDE_M), robot=robot.endpoint)
    wait_for(lambda: moved_m(robot) > 1.3 * SIDE_M, "the second side")
    assert robot.daemon.end() == 0
    robot.settled_truth()
    robot.start_daemon()
    done = running.done()
    assert done.code == 0, done
    # The program saw nothing of how the robot braked: more on a busy machine.
    assert_square(robot, done.out, unseen_m=0.15, unseen_rad=0.4)


@square
@pytest.mark.parametrize(
    "number", [signal.SIGKILL, pytest.param(signal.SIGSTOP, marks=pytest.mark.nightly)]
)
def test_a_program_that_is_killed_or_frozen_in_mid_square_leaves_a_robot_that_stands(
    program: Any, robot: RealRobot, number: int
) -> None:
    running = program.start("square", robot=robot.endpoint)
    wait_for(lambda: moved_m(robot) > 0.1, "it drives")
    running.send(number)
    sent_ns = time.monotonic_ns()
    truth = robot.settled_truth()
    before = next(each for each in robot.truth() if each.t_ns >= sent_ns)
    # 0.25 m/s for the daemon's timeout of 0.5 s, and as much again for this machine's delays.
    assert math.hypot(truth.x - before.x, truth.y - before.y) < 0.25


@pytest.fixture
def fake() -> Iterator[FakeRobot]:
    """Poses that can be withheld, and a record of commands."""
    robot = FakeRobot()
    yield robot
    robot.close()


@square
@pytest.mark.parametrize(
    "payload",
    [
        pytest.param(b"", id="silence"),
        pytest.param(b'{"x": 1}', id="half", marks=pytest.mark.nightly),
        pytest.param(b"\x81", id="other", marks=pytest.mark.nightly),
    ],
)
def test_without_readable_poses_a_program_sends_zero_until_they_are_back(
    program: Any, fake: FakeRobot, payload: bytes
) -> None:
    running = program.start("square", robot=fake.endpoint)
    fake.drives()
    fake.payload = payload
    fake.stands()
    fake.payload = None
    fake.drives()
    assert running.running


@square
def test_its_commands_are_as_the_schema_says_with_a_stamp_and_in_bounds(
    program: Any, fake: FakeRobot
) -> None:
    program.start("square", robot=fake.endpoint)
    wait_for(lambda: len(fake.commands) >= 40, "two seconds of commands")
    # More of them come meanwhile.
    for command in fake.commands[:40]:
        jsonschema.validate(command, COMMAND)
        assert abs(command["vx"]) <= 0.3
        assert abs(command["wz"]) <= 1.5
    stamps = [command["stamp_ns"] for command in fake.commands]
    assert stamps == sorted(set(stamps))
    assert abs(stamps[-1] - time.time_ns()) < 60e9


@square
@pytest.mark.parametrize(
    "number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.nightly)]
)
def test_a_program_that_is_ended_by_a_signal_sends_zero_last(
    program: Any, fake: FakeRobot, number: int
) -> None:
    running = program.start("square", robot=fake.endpoint)
    fake.drives()
    running.send(number)
    assert running.done().code != 0
    wait_for(lambda: not fake.commands[-1]["vx"] and not fake.commands[-1]["wz"], "zero")


@square
def test_an_emergency_stop_in_mid_square_ends_it_and_the_program_says_why(
    program: Any, robot: RealRobot, client: Callable[..., Client]
) -> None:
    app = client("client", robot.endpoint)
    running = program.start("square", robot=robot.endpoint)
    wait_for(lambda: moved_m(robot) > 0.1, "it drives")
    assert app.ask("yahboomd/estop", b'{"by": "the red button"}')["success"]
    done = running.done()
    assert done.code == WILL_NOT_MOVE, done
    assert "the red button" in done.err
    assert len(done.err.splitlines()) <= 3
    # So does one that starts while the stop is engaged.
    done = program.run("square", robot=robot.endpoint)
    assert (done.code, "the red button" in done.err) == (WILL_NOT_MOVE, True), done
