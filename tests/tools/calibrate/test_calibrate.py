"""`yahboomd calibrate` on a real daemon and a simulated robot whose true size differs."""

from __future__ import annotations

import codecs
import json
import math
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from real_robot import RealRobot, wait_for

from yahboomd.simulation.truth import TruthSample

pytestmark = pytest.mark.realtime

LEFT, RIGHT = 0.995, 1.005
TRUE_RADIUS_M, TRUE_TRACK_M = 0.0345, 0.162
"""Configured are 0.0335 and 0.150."""

FREE = "Enter when its way is free"


class Wizard:
    """The command in a process of its own; its questions are answered as a person would."""

    def __init__(self, robot: RealRobot, state: Path, *arguments: str) -> None:
        self._written = ""
        self._answered = 0
        robot_at = ("--connect", robot.endpoint)
        self.process = subprocess.Popen(
            [sys.executable, "-m", "yahboomd", "calibrate", *arguments, *robot_at],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={**os.environ, "STATE_DIRECTORY": str(state)},
            bufsize=0,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stderr is not None
        decoder = codecs.getincrementaldecoder("utf-8")()
        while got := self.process.stderr.read(256):
            self._written += decoder.decode(got)

    @property
    def asked(self) -> str:
        """Its output since the latest answered question."""
        return self._written[self._answered :]

    def answer(self, question: str, text: str = "") -> None:
        """Wait for the question after all that was answered, and answer it."""
        wait_for(lambda: question in self.asked or not self._reader.is_alive(), question)
        assert question in self.asked, self.asked
        self._answered = self._written.index(question, self._answered) + len(question)
        assert self.process.stdin is not None
        self.process.stdin.write(text.encode() + b"\n")

    def moved(self, robot: RealRobot, question: str) -> tuple[TruthSample, TruthSample]:
        """Let it move until this is asked; again, if a busy machine let the run lapse.

        Returns:
            The begin and the end of the movement that counts.
        """
        while True:
            begin = robot.settled_truth()
            self.answer(FREE)
            wait_for(lambda: question in self.asked or FREE in self.asked, question)
            if FREE not in self.asked:
                return begin, robot.settled_truth()

    def ends(self) -> int:
        status = self.process.wait(60)
        self._reader.join()
        return status

    def printed(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.read().decode()

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        self._reader.join()
        for stream in (self.process.stdin, self.process.stdout, self.process.stderr):
            assert stream is not None
            stream.close()


@pytest.fixture
def wizard(
    real_robot: Callable[..., RealRobot], tmp_path: Path
) -> Iterator[tuple[RealRobot, Callable[..., Wizard]]]:
    robot = real_robot(
        simulate=["--wheel-radius", str(TRUE_RADIUS_M), "--wheel-separation", str(TRUE_TRACK_M)],
        # What squares would correct; a tape as well, if the bend of its straight is measured.
        run=["--set", f"chassis.wheel_radius_multiplier={{left={LEFT}, right={RIGHT}}}"],
    )
    robot.daemon.says("Connected to")
    started: list[Wizard] = []

    def start(*arguments: str) -> Wizard:
        started.append(Wizard(robot, tmp_path, *arguments))
        return started[-1]

    yield robot, start
    for each in started:
        each.close()


def test_a_straight_and_turns_give_the_true_size_and_the_file_that_the_daemon_reads(
    wizard: tuple[RealRobot, Callable[..., Wizard]], tmp_path: Path
) -> None:
    robot, start = wizard
    quick = ("--straight", "1", "--turns", "1", "--speed", "0.4", "--turn-speed", "2")
    asked = start("tape", *quick, "--json")
    begin, end = asked.moved(robot, "How far did it truly go")
    asked.answer("How far did it truly go", f"{math.hypot(end.x - begin.x, end.y - begin.y):.4f}")
    dx, dy = end.x - begin.x, end.y - begin.y
    left_m = dy * math.cos(begin.theta) - dx * math.sin(begin.theta)
    asked.answer("How far to the left", f"{1e3 * left_m:.2f}")
    for _ in range(2):
        begin, end = asked.moved(robot, "How many degrees beyond")
        beyond = math.degrees(abs(end.theta - begin.theta)) - 360.0
        asked.answer("How many degrees beyond", f"{beyond:.3f}")
    assert asked.ends() == 0, asked.asked

    result = json.loads(asked.printed())
    radii = result["chassis"]["wheel_radius_multiplier"]
    # Truly they are alike: the straight bent, since the configuration has them otherwise.
    assert radii["right"] / radii["left"] == pytest.approx(1.0, abs=2e-3)
    assert abs(left_m) > 0.005
    assert sum(radii.values()) / 2.0 == pytest.approx(TRUE_RADIUS_M / 0.0335, rel=2e-3)
    assert result["chassis"]["wheel_separation_multiplier"] == pytest.approx(
        TRUE_TRACK_M / 0.150, rel=2e-3
    )
    shown = subprocess.run(
        [sys.executable, "-m", "yahboomd", "config", "show", "--origin"],
        env={**os.environ, "STATE_DIRECTORY": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    (track,) = [line for line in shown.splitlines() if "wheel_separation_multiplier =" in line]
    assert str(result["chassis"]["wheel_separation_multiplier"]) in track
    assert f"{tmp_path / 'calibration.toml'} (tape, " in track


def test_ctrl_c_in_mid_run_stops_the_wheels_and_writes_nothing(
    wizard: tuple[RealRobot, Callable[..., Wizard]], tmp_path: Path
) -> None:
    robot, start = wizard
    asked = start("squares", "--speed", "0.3")
    asked.answer(FREE)

    def drives() -> bool:
        # After a run that a busy machine let lapse, the question is repeated.
        if FREE in asked.asked:
            asked.answer(FREE)
        return max(map(abs, robot.truth()[-1].speed_m_s)) > 0.1

    wait_for(drives, "it drives")
    asked.process.send_signal(signal.SIGINT)
    assert asked.ends() == 130
    robot.settled_truth()
    assert "the wheels were stopped and stand; nothing was written" in asked.asked
    assert not (tmp_path / "calibration.toml").exists()
