"""Every example that drives by moves does so on a real daemon, and is lost in every way."""

from __future__ import annotations

import json
import math
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from real_robot import Client, Process, RealRobot, wait_for

pytestmark = [pytest.mark.realtime, pytest.mark.commands("moves")]

SIDE_M = 0.2
NEAR_M = 0.06
"""A busy machine delays poses and commands; make moves has what is reached without that."""

QUIET_WITHIN_S = 240.0
NO_DAEMON, WILL_NOT_MOVE = 69, 75
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def robot(real_robot: Callable[..., RealRobot], namespace: str) -> RealRobot:
    made = real_robot(run=["--set", "faults.stall=report", "--set", f"zenoh.namespace={namespace}"])
    made.daemon.says("Connected")
    return made


class Attempt(NamedTuple):
    """What a program was, and whether this machine was too busy for it."""

    done: Any
    disturbed: bool


def driven(robot: RealRobot, application: Client, run: Callable[[], Attempt]) -> Any:
    """Have a square of ``SIDE_M`` driven; the wheels are where they began, by the truth.

    A machine that is busy for 0.3 s ends moves, as it should: then once more, from that place.
    """
    until_s = time.monotonic() + QUIET_WITHIN_S
    while True:
        start = robot.settled_truth()
        application.in_state("standing")
        attempt = run()
        if not attempt.disturbed or time.monotonic() > until_s:
            break
    assert not attempt.disturbed, f"this machine was never quiet for a square: {attempt.done}"
    end = robot.settled_truth()
    assert math.dist((end.x, end.y), (start.x, start.y)) < NEAR_M, (start, end)
    assert end.theta - start.theta == pytest.approx(math.tau, abs=0.2)
    cos, sin = math.cos(start.theta), math.sin(start.theta)
    path = [
        (each.x - start.x, each.y - start.y) for each in robot.truth() if each.t_ns > start.t_ns
    ]
    for x, y in ((SIDE_M, 0.0), (SIDE_M, SIDE_M), (0.0, SIDE_M)):
        corner = (cos * x - sin * y, sin * x + cos * y)
        assert min(math.dist(place, corner) for place in path) < NEAR_M, corner
    return attempt.done


BUSY = {
    # None were driven, or the program gave up before they ended: no progress came in time.
    "",
    *("fault", "no_pose", "pose_changed", "client_silent", "not_obeyed", "board_lost"),
    # The small pulses at the end need poses in time.
    *("uncertain", "short", "blocked"),
}


def driving(program: Any, robot: RealRobot) -> Any:
    """A program in mid-move; started again if a busy machine ended its moves at once."""
    running = program.start("moves", "3", robot=robot.endpoint)
    begin_m = robot.travelled_m()

    def drives() -> bool:
        nonlocal running, begin_m
        if not running.running:
            running = program.start("moves", "3", robot=robot.endpoint)
            begin_m = robot.travelled_m()
        return robot.travelled_m() - begin_m > 0.2

    wait_for(drives, "it drives")
    return running


@pytest.mark.parametrize(
    "namespace", ["", pytest.param("bot1", marks=pytest.mark.nightly)], indirect=True
)
def test_a_square_of_moves_ends_where_it_began(
    program: Any,
    robot: RealRobot,
    service: Process,
    client: Callable[..., Client],
    namespace: str,
) -> None:
    keys = f"{namespace}/yahboomd".lstrip("/")
    application = client("client", robot.endpoint, keys)

    def run() -> Attempt:
        done = program.run("moves", str(SIDE_M), robot=robot.endpoint, namespace=namespace)
        if done.code == 0:
            return Attempt(done, disturbed=False)
        reason = application.ask(f"{keys}/moves").get("reason", "")
        assert done.code in {NO_DAEMON, WILL_NOT_MOVE}, done
        assert reason in BUSY, (done, reason)
        return Attempt(done, disturbed=True)

    *progress, last = driven(robot, application, run).out.splitlines()
    assert len(progress) > 20
    assert json.loads(last)["reason"] == "reached"


@pytest.mark.parametrize(
    "number",
    [
        pytest.param(signal.SIGKILL, id="killed"),
        pytest.param(signal.SIGSTOP, id="frozen", marks=pytest.mark.nightly),
        pytest.param(signal.SIGTERM, id="ended", marks=pytest.mark.nightly),
        pytest.param(signal.SIGINT, id="interrupted", marks=pytest.mark.nightly),
    ],
)
def test_a_program_that_is_lost_in_mid_move_leaves_a_robot_that_stands_and_no_move(
    program: Any,
    robot: RealRobot,
    service: Process,
    client: Callable[..., Client],
    number: int,
) -> None:
    running = driving(program, robot)
    running.send(number)
    before = robot.truth()[-1]
    truth = robot.settled_truth()
    # 0.3 m/s for the half second without a beat, and as much again for this machine's delays.
    assert math.hypot(truth.x - before.x, truth.y - before.y) < 0.35
    app = client("client", robot.endpoint)
    end = app.ask("yahboomd/moves")
    assert (end["state"], end["reason"] != "reached") == ("ended", True), end


def test_without_the_service_a_program_says_so(program: Any, robot: RealRobot) -> None:
    done = program.run("moves", robot=robot.endpoint)
    assert done.code == 69, done
    assert "`yahboomd moves`" in done.err


@pytest.mark.nightly
def test_a_move_that_ends_before_its_goal_ends_the_program_with_the_reason(
    program: Any, robot: RealRobot, service: Process, client: Callable[..., Client]
) -> None:
    app = client("client", robot.endpoint)
    running = driving(program, robot)
    assert app.ask("yahboomd/estop", b'{"by": "the red button"}')["success"]
    done = running.done()
    assert done.code == WILL_NOT_MOVE, done
    assert "emergency stop" in done.err.lower()


def examples() -> dict[str, str]:
    """The programs with which docs/moves.md opens."""
    page = (ROOT / "docs" / "moves.md").read_text().split("## ")[0]
    found = {}
    for name, fence in (("python", "python"), ("shell", "sh")):
        found[name] = page.split(f"```{fence}\n")[1].split("```")[0]
    found["zenoh"] = page.split("```python\n")[2].split("```")[0]
    return found


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["python", "shell", "zenoh"])
def test_each_program_of_the_page_of_moves_drives_its_square(
    robot: RealRobot,
    service: Process,
    client: Callable[..., Client],
    tmp_path: Path,
    name: str,
) -> None:
    text = examples()[name]
    sides = text.replace("straight(0.5)", "straight(0.2)").replace("straight 0.5", "straight 0.2")
    sides = sides.replace('"distance_m": 0.5', '"distance_m": 0.2')
    assert sides != text
    program = sides.replace("Robot() as", f'Robot("{robot.endpoint}") as')
    program = program.replace("tcp/127.0.0.1:7448", robot.endpoint)
    file = tmp_path / "program"
    if name == "shell":
        command = f"{sys.executable} -m yahboomd"
        head = f'yahboomd() {{ {command} "$@" --connect {robot.endpoint}; }}\n'
        program = "set -e\n" + head + program
    file.write_text(program)
    words = ["sh", str(file)] if name == "shell" else [sys.executable, str(file)]
    application = client("client", robot.endpoint)

    def run() -> Attempt:
        done = subprocess.run(words, capture_output=True, text=True, timeout=180, check=False)
        reason = application.ask("yahboomd/moves").get("reason", "")
        disturbed = reason in BUSY
        assert disturbed or done.returncode == 0, (done, reason)
        return Attempt(done, disturbed=disturbed)

    driven(robot, application, run)
