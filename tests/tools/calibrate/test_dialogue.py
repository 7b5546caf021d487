"""A program leads the wizard; the robot moves only while it reports that a button is held."""

from __future__ import annotations

import math
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from led_calibration import LedCalibration
from real_robot import RealRobot, wait_for

from yahboomd.core.clock import SystemClock
from yahboomd.tools.calibrate.dialogue import Dialogue

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("led_calibration")]

TRUE_RADIUS_M, TRUE_TRACK_M = 0.0345, 0.162
"""Configured are 0.0335 and 0.150."""

QUICK = ("--straight", "1", "--turns", "1", "--speed", "0.4", "--turn-speed", "2")

LONG = ("--straight", "10", "--turns", "1", "--speed", "0.4", "--turn-speed", "2")
"""A test that is held up for seconds still ends it in mid-run."""

PARENT = """
import subprocess, sys, time, json, threading
child = subprocess.Popen(sys.argv[1:], stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0)
print(child.pid, flush=True)
asked = {}

def read():
    for line in child.stdout:
        asked.update(json.loads(line))

threading.Thread(target=read, daemon=True).start()
while True:
    hold = {"type": "hold", "id": asked.get("id"), "at_ns": time.monotonic_ns()}
    child.stdin.write(json.dumps(hold).encode() + b"\\n")
    time.sleep(0.05)
"""
"""A program that holds the button for as long as it lives."""


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RealRobot]:
    made = RealRobot(
        tmp_path_factory.mktemp("robot"),
        simulate=["--wheel-radius", str(TRUE_RADIUS_M), "--wheel-separation", str(TRUE_TRACK_M)],
    )
    made.daemon.says("Connected to")
    yield made
    made.close()


@pytest.fixture
def lead(robot: RealRobot, tmp_path: Path) -> Iterator[Callable[..., LedCalibration]]:
    started: list[LedCalibration] = []

    def start(*arguments: str) -> LedCalibration:
        started.append(LedCalibration(robot.endpoint, tmp_path, *arguments))
        return started[-1]

    yield start
    for each in started:
        each.close()


def moves(robot: RealRobot) -> bool:
    return max(map(abs, robot.truth()[-1].speed_m_s)) > 0.1


def test_a_whole_calibration_by_tape_with_the_button_held_writes_the_true_size(
    robot: RealRobot, lead: Callable[..., LedCalibration], tmp_path: Path
) -> None:
    led = lead("tape", *QUICK, "--held")
    asked = led.question()
    assert asked["bounds"] == {"distance_m": 1.0, "turn_rad": 0.0, "time_s": 8.8}
    assert "It moves 1 m, for at most 9 s." in asked["text"]
    begin, asked = led.moved_through(asked, robot.settled_truth)
    end = robot.settled_truth()
    assert (asked["kind"], asked["name"], asked["unit"]) == ("number", "length", "m")
    for wrong in ("far", "100", "0.1"):
        led.answer(asked, wrong)
        asked = led.question()
        assert re.match(
            r"A number of metres near 1\.0\d\d, which the wheels counted", asked["wrong"]
        )
    led.answer(asked, f"{math.hypot(end.x - begin.x, end.y - begin.y):.4f}")
    asked = led.question()
    assert (asked["name"], asked["unit"]) == ("left", "mm")
    led.answer(asked)
    for _ in range(2):
        begin, asked = led.moved_through(led.question(), robot.settled_truth)
        end = robot.settled_truth()
        led.answer(asked, f"{math.degrees(abs(end.theta - begin.theta)) - 360.0:.3f}")
    assert led.ends() == 0

    (result,) = led.of_type("result")
    assert result["facts"]["written"] == str(tmp_path / "calibration.toml")
    assert (tmp_path / "calibration.toml").exists()
    radii = result["facts"]["chassis"]["wheel_radius_multiplier"]
    assert radii == pytest.approx(dict.fromkeys(("left", "right"), TRUE_RADIUS_M / 0.0335), 2e-3)
    assert "radius left" in result["text"]
    assert led.of_type("progress")[0] == {"type": "progress", "part": 1, "parts": 1, "done": 0.0}
    assert led.of_type("say")[-1]["text"].startswith("Written to")


@pytest.mark.parametrize("way", ["released", "silent"])
def test_the_robot_stops_when_the_button_is_let_go_and_the_run_is_done_once_more(
    robot: RealRobot, lead: Callable[..., LedCalibration], tmp_path: Path, way: str
) -> None:
    led = lead("tape", *QUICK, "--held")
    first = led.question()
    begin = robot.settled_truth()
    first = led.moved_until(first, lambda: moves(robot))
    led.release() if way == "released" else led.fall_silent()
    asked = led.question()
    assert asked["text"].startswith("The button was let go")
    stopped = robot.settled_truth()
    assert math.hypot(stopped.x - begin.x, stopped.y - begin.y) < 0.9
    # The holds of the run that is over do not begin the next one.
    led.hold(first)
    wait_for(lambda: robot.truth()[-1].t_ns > stopped.t_ns + 1_000_000_000, "a second")
    assert robot.settled_truth().x == pytest.approx(stopped.x, abs=1e-4)
    _, after = led.moved_through(asked, robot.settled_truth)
    assert after["name"] == "length"
    led.send(type="abort")
    assert led.ends() == 1
    assert led.lines[-1]["type"] == "refused"
    assert "nothing was written" in led.lines[-1]["text"]
    assert not (tmp_path / "calibration.toml").exists()


def test_holds_that_are_late_move_nothing(
    robot: RealRobot, lead: Callable[..., LedCalibration]
) -> None:
    led = lead("tape", *QUICK, "--held")
    asked = led.question()
    begin = robot.settled_truth()
    for _ in range(20):
        led.send(type="hold", id=asked["id"], at_ns=time.monotonic_ns() - 400_000_000)
    led.send(type="nonsense")
    wait_for(lambda: led.of_type("ignored"), "all were read")
    read_ns = robot.truth()[-1].t_ns
    wait_for(lambda: robot.truth()[-1].t_ns > read_ns + 1_000_000_000, "time to drive")
    assert robot.settled_truth().travel_m == begin.travel_m
    assert led.of_type("progress") == []


@pytest.mark.parametrize("held", [("--held",), ()])
def test_an_input_that_ends_in_mid_run_stops_the_robot_and_nothing_is_written(
    robot: RealRobot, lead: Callable[..., LedCalibration], tmp_path: Path, held: tuple[str, ...]
) -> None:
    led = lead("tape", *LONG, *held)
    asked = led.question()
    begin = robot.settled_truth()
    led.moved_until(asked, lambda: moves(robot))
    assert led.process.stdin is not None
    led.fall_silent()
    led.process.stdin.close()
    assert led.ends() == 1
    stopped = robot.settled_truth()
    assert math.hypot(stopped.x - begin.x, stopped.y - begin.y) < 9.0
    assert "The input ended" in led.lines[-1]["text"]
    assert not (tmp_path / "calibration.toml").exists()


def test_a_program_that_is_killed_stops_the_robot_and_leaves_no_process(
    robot: RealRobot, tmp_path: Path
) -> None:
    parent = subprocess.Popen(
        [
            *(sys.executable, "-c", PARENT),
            *LedCalibration.command(robot.endpoint, ("tape", *LONG, "--held")),
        ],
        stdout=subprocess.PIPE,
        env={**os.environ, "STATE_DIRECTORY": str(tmp_path)},
    )
    with parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        wait_for(lambda: moves(robot), "it drives")
        begin = robot.truth()[-1]
        parent.kill()
    stopped = robot.settled_truth()
    assert math.hypot(stopped.x - begin.x, stopped.y - begin.y) < 9.0
    wait_for(lambda: not Path(f"/proc/{child}/cmdline").exists() or _zombie(child), "it ended")
    assert not (tmp_path / "calibration.toml").exists()


def _zombie(pid: int) -> bool:
    try:
        return ") Z " in Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return True


def test_ctrl_c_in_mid_run_stops_the_robot_and_nothing_is_written(
    robot: RealRobot, lead: Callable[..., LedCalibration], tmp_path: Path
) -> None:
    led = lead("tape", *LONG, "--held")
    led.moved_until(led.question(), lambda: moves(robot))
    led.process.send_signal(signal.SIGINT)
    assert led.ends() == 130
    robot.settled_truth()
    assert not (tmp_path / "calibration.toml").exists()


def test_holds_that_waited_while_the_command_was_frozen_do_not_move_the_robot_afterwards(
    robot: RealRobot, lead: Callable[..., LedCalibration]
) -> None:
    led = lead("tape", *LONG, "--held")
    led.moved_until(led.question(), lambda: moves(robot))
    led.process.send_signal(signal.SIGSTOP)
    stopped = robot.settled_truth()
    led.fall_silent()
    wait_for(lambda: robot.truth()[-1].t_ns > stopped.t_ns + 300_000_000, "the last hold is old")
    led.process.send_signal(signal.SIGCONT)
    assert led.question()["text"].startswith("The button was let go")
    assert robot.settled_truth().travel_m == pytest.approx(stopped.travel_m, abs=2e-3)


def test_a_command_that_was_frozen_in_mid_run_does_the_run_once_more(
    robot: RealRobot, lead: Callable[..., LedCalibration]
) -> None:
    led = lead("tape", *LONG)
    led.moved_until(led.question(), lambda: moves(robot))
    led.process.send_signal(signal.SIGSTOP)
    stopped = robot.settled_truth()
    wait_for(lambda: robot.truth()[-1].t_ns > stopped.t_ns + 2_500_000_000, "it was long")
    led.process.send_signal(signal.SIGCONT)
    asked = led.question()
    assert asked["text"].startswith("The daemon was lost for a moment, or this machine was too")
    assert robot.settled_truth().travel_m == pytest.approx(stopped.travel_m, abs=2e-3)
    led.moved_until(asked, lambda: moves(robot))


def test_a_board_that_is_silent_for_a_moment_costs_no_more_than_the_run(
    robot: RealRobot, lead: Callable[..., LedCalibration]
) -> None:
    led = lead("tape", *QUICK)
    led.moved_until(led.question(), lambda: moves(robot))
    robot.do("mute 0.7")
    asked = led.question()
    # A command that is repeated meanwhile may drive on before this is noticed.
    assert asked["name"] == "length" or "This run does not count" in asked["text"]


def test_a_run_in_which_counts_were_lost_does_not_count(
    robot: RealRobot, lead: Callable[..., LedCalibration]
) -> None:
    led = lead("tape", *QUICK)
    led.moved_until(led.question(), lambda: moves(robot))
    assert robot.do("reset").startswith("ok")
    assert "This run does not count" in led.question()["text"]


def test_a_robot_that_is_not_there_is_refused_in_the_dialogue_too(
    lead: Callable[..., LedCalibration],
) -> None:
    led = lead("tape", "--timeout", "0", "--namespace", "another")
    assert led.ends() == 69
    assert led.lines[-1]["status"] == 69


def test_a_file_that_could_not_be_written_is_refused_before_anything_moves(
    robot: RealRobot, lead: Callable[..., LedCalibration], tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("no folder")
    file = f"chassis.calibration_file={tmp_path / 'file' / 'calibration.toml'}"
    led = lead("tape", "--set", file)
    assert led.ends() == 78
    assert "cannot be written" in led.lines[-1]["text"]
    assert led.of_type("question") == []


def test_progress_is_reported_now_and_then_and_at_the_end() -> None:
    told: list[dict[str, Any]] = []
    dialogue = Dialogue(told.append, SystemClock())
    for each in range(1000):
        dialogue.progress(1, 2, each / 1000.0)
    dialogue.progress(1, 2, 1.0)
    dialogue.progress(2, 2, 0.0)
    assert [(each["part"], each["done"]) for each in (told[0], *told[-2:])] == [
        (1, 0.0),
        (1, 1.0),
        (2, 0.0),
    ]
    assert len(told) < 20
