"""`yahboomd calibrate` in a terminal, on a real daemon and a simulated robot of another size."""

from __future__ import annotations

import asyncio
import math
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from real_robot import RealRobot, wait_for
from zenoh_fixtures import eventually

from yahboomd.core.config import read
from yahboomd.simulation.truth import TruthSample

pytestmark = pytest.mark.realtime

TRUE_RADIUS_M, TRUE_TRACK_M = 0.0345, 0.162
"""Configured are 0.0335 and 0.150."""

FREE = "Enter when its way is free"


@pytest.fixture
def robot(
    real_robot: Callable[..., RealRobot], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> RealRobot:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    size = ("--wheel-radius", str(TRUE_RADIUS_M), "--wheel-separation", str(TRUE_TRACK_M))
    made = real_robot(simulate=size)
    made.daemon.says("Connected to")
    return made


def moves(robot: RealRobot) -> bool:
    return max(map(abs, robot.truth()[-1].speed_m_s)) > 0.1


class Dialogue:
    """The questions on a terminal; each is answered once."""

    def __init__(self, process: Any) -> None:
        self.process = process
        self._answered = 0

    def asks(self, question: str) -> bool:
        return question in self.process.written[self._answered :]

    async def answer(self, question: str, text: str = "") -> None:
        await eventually(lambda: self.asks(question) or self.process.process.poll() is not None)
        assert self.asks(question), self.process.screen
        self._answered = self.process.written.index(question, self._answered) + len(question)
        self.process.type(f"{text}\n")

    async def moved(self, robot: RealRobot, question: str) -> tuple[TruthSample, TruthSample]:
        """The ends of a run; it is repeated if a busy machine let it lapse."""
        while True:
            begin = await asyncio.to_thread(robot.settled_truth)
            await self.answer(FREE)
            await eventually(lambda: self.asks(question) or self.asks(FREE))
            if self.asks(question):
                return begin, await asyncio.to_thread(robot.settled_truth)


@pytest.mark.nightly
async def test_a_straight_and_turns_give_the_true_size_to_the_file_that_the_daemon_reads(
    robot: RealRobot, terminal: Any, tmp_path: Path
) -> None:
    quick = ("--straight", "1", "--turns", "1", "--speed", "0.4", "--turn-speed", "2")
    asked = Dialogue(terminal("calibrate", "tape", *quick, "--connect", robot.endpoint))
    begin, end = await asked.moved(robot, "How far did it truly go")
    way_m = math.hypot(end.x - begin.x, end.y - begin.y)
    await asked.answer("How far did it truly go", f"{way_m:.4f}")
    await asked.answer("How far to the left")
    for question in ("To which side did it turn", "How many degrees beyond"):
        begin, end = await asked.moved(robot, question)
        if question.startswith("To"):
            await asked.answer(question, "1")
        beyond = math.degrees(abs(end.theta - begin.theta)) - 360.0
        await asked.answer("How many degrees beyond", f"{beyond:.3f}")
    assert await asked.process.ended() == 0, asked.process.screen
    chassis = read(None, environ={"STATE_DIRECTORY": str(tmp_path)}).config.chassis
    for multiplier in chassis.wheel_radius_multiplier.values():
        assert multiplier == pytest.approx(TRUE_RADIUS_M / 0.0335, rel=5e-3)
    assert chassis.wheel_separation_multiplier == pytest.approx(TRUE_TRACK_M / 0.150, rel=5e-3)


async def test_ctrl_c_in_mid_run_stops_the_wheels_and_writes_nothing(
    robot: RealRobot, terminal: Any, tmp_path: Path
) -> None:
    asked = Dialogue(terminal("calibrate", "squares", "--connect", robot.endpoint))
    await asked.answer(FREE)
    # A run that a busy machine let lapse is asked for again.
    async with asyncio.timeout(300.0):
        while not moves(robot):
            if asked.asks(FREE):
                await asked.answer(FREE)
            await asyncio.sleep(0.01)
    asked.process.type("\x03")
    assert await asked.process.ended() == 130
    await asyncio.to_thread(robot.settled_truth)
    # A daemon that was starved may have had no counts that show standing wheels.
    stood = "the wheels were stopped and stand; nothing was written"
    unseen = "the wheels were not seen to stand. Look at them, or run `yahboomd stop`. Nothing was"
    assert stood in asked.process.screen or unseen in asked.process.screen
    assert not (tmp_path / "calibration.toml").exists()


PARENT = """
import json, subprocess, sys, threading, time
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
"""A program that leads the dialogue, and holds the button for as long as it lives."""


@pytest.mark.nightly
def test_a_leading_program_that_is_killed_stops_the_robot_and_leaves_no_process(
    robot: RealRobot, tmp_path: Path
) -> None:
    words = ("calibrate", "tape", "--straight", "10", "--dialogue", "json", "--held")
    command = [sys.executable, "-m", "yahboomd", *words, "--connect", robot.endpoint]
    with subprocess.Popen(
        [sys.executable, "-c", PARENT, *command], stdout=subprocess.PIPE
    ) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        wait_for(lambda: moves(robot), "it drives")
        begin = robot.truth()[-1]
        parent.kill()
    stopped = robot.settled_truth()
    assert math.hypot(stopped.x - begin.x, stopped.y - begin.y) < 9.0
    # Dead, or a zombie that nobody has fetched.
    wait_for(lambda: not os.path.exists(f"/proc/{child}/exe"), "the command ends")
    assert not (tmp_path / "calibration.toml").exists()
