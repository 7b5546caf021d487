"""A program leads the wizard; the robot moves only while it reports that a button is held."""

from __future__ import annotations

import asyncio
import json
import math
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from bench_client import BenchClient
from led_calibration import LedCalibration
from real_robot import RealRobot, wait_for
from robot_bench import RobotBench

from yahboomd.core.clock import SystemClock
from yahboomd.core.config import Loaded
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.calibrate.calibration import calibrate
from yahboomd.tools.calibrate.choices import TapeRuns
from yahboomd.tools.calibrate.dialogue import Dialogue
from yahboomd.tools.calibrate.hold import HeldButton

pytestmark = pytest.mark.xdist_group("led_calibration")

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


@pytest.mark.realtime
def test_the_robot_stops_when_the_button_is_let_go_and_the_run_is_done_once_more(
    robot: RealRobot, lead: Callable[..., LedCalibration], tmp_path: Path
) -> None:
    led = lead("tape", *QUICK, "--held")
    first = led.question()
    begin = robot.settled_truth()
    first = led.moved_until(first, lambda: moves(robot))
    led.send(type="nonsense")
    led.release()
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
    assert led.of_type("ignored")
    assert led.lines[-1]["type"] == "refused"
    assert "nothing was written" in led.lines[-1]["text"]
    assert not (tmp_path / "calibration.toml").exists()


@pytest.mark.realtime
def test_an_input_that_ends_in_mid_run_stops_the_robot_and_nothing_is_written(
    robot: RealRobot, lead: Callable[..., LedCalibration], tmp_path: Path
) -> None:
    led = lead("tape", *LONG, "--held")
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


@pytest.mark.realtime
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


@pytest.mark.realtime
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


@pytest.mark.realtime
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
    # The daemon was lost for a moment; or its board was, if this machine was busy besides.
    assert "This run does not count: put the robot back on its mark" in asked["text"]
    assert robot.settled_truth().travel_m == pytest.approx(stopped.travel_m, abs=2e-3)
    led.moved_until(asked, lambda: moves(robot))


@pytest.mark.realtime
def test_a_board_that_is_silent_for_a_moment_costs_no_more_than_the_run(
    robot: RealRobot, lead: Callable[..., LedCalibration]
) -> None:
    led = lead("tape", *QUICK)
    led.moved_until(led.question(), lambda: moves(robot))
    robot.do("mute 0.7")
    asked = led.question()
    # A command that is repeated meanwhile may drive on before this is noticed.
    assert asked["name"] == "length" or "This run does not count" in asked["text"]


@pytest.mark.realtime
def test_a_run_in_which_counts_were_lost_does_not_count(
    robot: RealRobot, lead: Callable[..., LedCalibration]
) -> None:
    led = lead("tape", *QUICK)
    led.moved_until(led.question(), lambda: moves(robot))
    assert robot.do("reset").startswith("ok")
    assert "This run does not count" in led.question()["text"]


@pytest.mark.realtime
def test_a_robot_that_is_not_there_is_refused_in_the_dialogue_too(
    lead: Callable[..., LedCalibration],
) -> None:
    led = lead("tape", "--timeout", "0", "--namespace", "another")
    assert led.ends() == 69
    assert led.lines[-1]["status"] == 69


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


@on_virtual_time
async def test_a_whole_calibration_is_asked_for_in_messages_and_led_by_answers(
    tmp_path: Path,
) -> None:
    told: list[dict[str, Any]] = []
    robot = SimulationOptions(wheel_radius_m=TRUE_RADIUS_M, wheel_separation_m=TRUE_TRACK_M)
    async with RobotBench(tmp_path, (), robot) as bench, BenchClient(bench) as client:
        await bench.ready()
        hold = HeldButton(bench.clock, client.stop)
        dialogue = Dialogue(told.append, bench.clock, hold)
        file = tmp_path / "calibration.toml"
        loaded = Loaded(bench.config, None, calibration_path=file)  # type: ignore[arg-type]
        choices = TapeRuns(straight_m=1.0, turns=1, speed_m_s=0.4, turn_speed_rad_s=2.0)
        work = asyncio.create_task(
            calibrate(client, loaded, choices, dialogue, hold, clock=bench.clock)  # type: ignore[arg-type]
        )

        async def asked(before: str) -> dict[str, Any]:
            def newest() -> dict[str, Any]:
                questions = [each for each in told if each["type"] == "question"]
                return questions[-1] if questions else {"id": ""}

            await bench.until(lambda: newest()["id"] != before or work.done())
            return newest()

        async def held(question: dict[str, Any]) -> dict[str, Any]:
            while (after := told[-1]) == question or after["type"] == "progress":
                dialogue.press(question["id"], bench.clock.now_ns())
                await asyncio.sleep(0.05)
            return await asked(question["id"])

        question = await asked("")
        assert question["bounds"] == {"distance_m": 1.0, "turn_rad": 0.0, "time_s": 8.8}
        assert "It moves 1 m, for at most 9 s." in question["text"]
        # Holds that are late, and of no question.
        for _ in range(20):
            dialogue.press(question["id"], bench.clock.now_ns() - 400_000_000)
            dialogue.press("move-0", bench.clock.now_ns())
            await asyncio.sleep(0.05)
        assert bench.standing
        question = await held(question)
        assert (question["kind"], question["name"], question["unit"]) == ("number", "length", "m")
        for wrong in ("far", "100", "0.1"):
            assert dialogue.answer(question["id"], wrong)
            question = await asked(question["id"])
            assert question["wrong"].startswith("A number of metres near 1.0")
        for name, text in (("length", "1.03"), ("left", ""), ("beyond", "3"), ("beyond", "3")):
            if question["kind"] == "hold":
                question = await held(question)
            assert question["name"] == name
            assert dialogue.answer(question["id"], text)
            assert not dialogue.answer(question["id"], text)
            question = await asked(question["id"])
        await work
    progress = next(each for each in told if each["type"] == "progress")
    assert progress == {"type": "progress", "part": 1, "parts": 1, "done": 0.0}
    result, said = told[-2:]
    assert result["facts"]["written"] == str(file)
    assert "radius left" in result["text"]
    assert said["text"].startswith("Written to")
    # As lines have it.
    assert json.loads(json.dumps(result))["facts"]["method"] == "tape"
    assert file.exists()
