"""`yahboomd setup` as a process on a simulated board: a newcomer's way, and every end."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from process_priority import DAEMON_NICE, prefer
from zenoh_fixtures import eventually

from yahboomd.cli.main import main

pytestmark = pytest.mark.realtime

KNOWN = (
    *("--profile", "520", "--kinematics", "differential"),
    *("--wheel-diameter", "67", "--wheel-separation", "150"),
)


class Board:
    """A simulated board that can be asked for its truth at once."""

    def __init__(self, simulated_board: Callable[..., Any], folder: Path, *options: str) -> None:
        self._control = folder / "control"
        self.board = simulated_board("--control", str(self._control), *options)
        self.port: str = self.board.port

    def do(self, command: str) -> str:
        with socket.socket(socket.AF_UNIX) as control:
            control.connect(str(self._control))
            control.sendall(f"{command}\n".encode())
            answer = control.makefile().readline()
        assert answer.startswith("ok"), answer
        return answer.removeprefix("ok").strip()

    def truth(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self.do("pose"))
        return found

    def turns(self) -> bool:
        return max(map(abs, self.truth()["speed_m_s"])) > 0.1

    def stands(self) -> bool:
        return max(map(abs, self.truth()["speed_m_s"])) < 0.01


@pytest.fixture
def board(simulated_board, tmp_path, monkeypatch) -> Callable[..., Board]:
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path / "run"))
    return lambda *options: Board(simulated_board, tmp_path, *options)


async def turned(process: Any, board: Board, name: str) -> list[float]:
    """Let the next motor turn; how far each wheel rolled."""
    await process.shows(f"Enter, and {name} turns:")
    before = board.truth()["travel_m"]
    count = process.written.count("Which wheel turned?")
    process.type("\n")
    await eventually(
        lambda: (
            process.written.count("Which wheel turned?") > count
            or process.process.poll() is not None
        )
    )
    assert process.written.count("Which wheel turned?") > count, process.screen
    after = board.truth()["travel_m"]
    return [new - old for new, old in zip(after, before, strict=True)]


async def answer(process: Any, question: str, text: str) -> None:
    await process.shows(question)
    process.type(f"{text}\n")


def preferred(process: Any) -> Any:
    """Pulses are in real time, as a daemon drives."""
    prefer(process.process, DAEMON_NICE)
    return process


def scripted(robot: Board, folder: Path, text: str, *options: str) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "yahboomd", "setup", "--port", robot.port, *KNOWN, *options]
    with subprocess.Popen(
        command,
        cwd=folder,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        prefer(process, DAEMON_NICE)
        out, err = process.communicate(text)
    return subprocess.CompletedProcess(command, process.returncode, out, err)


ANSWERS = "n\nyes\n\n1\nf\n\n0\n\n2\nf\n"
"""Store nothing; the wheels are lifted; M1 left, M2 none, M3 right, both forward."""


@pytest.mark.nightly
def test_a_program_answers_on_standard_input_and_reads_one_line_of_json(board, tmp_path) -> None:
    # A wheel that sticks turns at a second try only, which these answers do not know.
    robot = board("--sticks", "1,1,1,1")
    done = scripted(robot, tmp_path, ANSWERS, "--json", "--output", "bot.toml")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["motors"] == [
        {"wheel": "left", "position": 1, "sign": 1},
        {"wheel": "right", "position": 3, "sign": 1},
    ]
    assert (found["file"], found["faults"], found["dialect"]) == ("bot.toml", [], "streamed")
    assert main(["config", "check", "--config", str(tmp_path / "bot.toml")]) == 0


@pytest.mark.parametrize(
    ("option", "words"),
    [
        (("--profile", "521"), "--profile knows no '521'; there are 520"),
        (("--kinematics", "hover"), "--kinematics knows no 'hover'"),
    ],
)
def test_what_it_does_not_know_is_named(capsys, option, words) -> None:
    assert main(["setup", *option]) == 78
    assert words in capsys.readouterr().err


SLOW = ("--lines", "3", "--flash", "dead_zone=1900")
"""Few counts, though enough to be seen soon: the pulses last as long as any."""


async def pulsing(
    board: Callable[..., Board], terminal: Any, robot: Board | None = None
) -> tuple[Board, Any]:
    """A robot whose left wheel turns at this moment, by a pulse of setup."""
    robot = robot or board(*SLOW)
    process = preferred(terminal("setup", "--port", robot.port, *KNOWN))
    await answer(process, "Are all wheels off the ground? Type yes:", "yes")
    answered = dict.fromkeys(("Enter, and M1 turns:", "Which wheel turned?"), 0)

    def turns() -> bool:
        for question, text in zip(answered, ("\n", "a\n"), strict=True):
            # Again, if this test was held up for as long as the pulse was.
            if process.written.count(question) > answered[question]:
                answered[question] += 1
                process.type(text)
        return robot.turns() or process.process.poll() is not None

    await eventually(turns)
    assert process.process.poll() is None, process.screen
    return robot, process


@pytest.mark.nightly
@pytest.mark.parametrize("how", ["ctrl-c", "SIGTERM", "hang-up", "yahboomd stop"])
async def test_however_it_is_ended_in_a_pulse_the_wheels_stand_and_no_file_is_there(
    board, terminal, yahboomd, tmp_path, how
) -> None:
    robot, process = await pulsing(board, terminal)
    if how == "ctrl-c":
        process.type("\x03")
        assert await process.ended() == 130
    elif how == "SIGTERM":
        process.process.terminate()
        assert await process.ended() == 143
    elif how == "yahboomd stop":
        stopped = await asyncio.to_thread(yahboomd, "stop", "--port", robot.port)
        assert robot.stands()
        assert stopped.returncode == 0, stopped.stderr
        assert f"yahboomd setup` (pid {process.process.pid}) has {robot.port}" in stopped.stderr
        assert await process.ended() == 143
    else:
        process.hang_up()
        await eventually(lambda: process.process.poll() is not None)
    await eventually(robot.stands)
    assert not list(tmp_path.glob("*robot.toml*"))
    assert not list(tmp_path.glob(".robot.toml*"))
    # The port is free again.
    stopped = await asyncio.to_thread(yahboomd, "stop", "--direct", "--port", robot.port)
    assert stopped.returncode == 0, stopped.stderr


@pytest.mark.parametrize(
    "number", [signal.SIGKILL, pytest.param(signal.SIGSTOP, marks=pytest.mark.nightly)]
)
async def test_killed_or_hung_in_a_pulse_the_wheels_are_stopped_by_the_guard(
    board, terminal, tmp_path, number
) -> None:
    robot, process = await pulsing(board, terminal)
    process.process.send_signal(number)
    await eventually(robot.stands)
    assert not (tmp_path / "robot.toml").exists()


async def unplugged(board: Callable[..., Board], terminal: Any) -> tuple[Board, Any]:
    """A robot whose left wheel turns on, since the cable came out in a pulse of setup."""
    robot = None
    for _ in range(20):
        robot, process = await pulsing(board, terminal, robot)
        robot.do("unplug")
        await process.shows("went away")
        if "Plug the board in again" in process.screen:
            break
        # This test was held up for as long as the pulse was.
        robot.do("replug")
    await process.shows("Plug the board in again")
    assert robot.turns()
    return robot, process


async def test_the_cable_out_in_a_pulse_is_waited_for_and_the_wheel_is_stopped(
    board, terminal, tmp_path
) -> None:
    robot, process = await unplugged(board, terminal)
    assert process.process.poll() is None
    robot.do("replug")
    assert await process.ended() == os.EX_TEMPFAIL
    assert robot.stands()
    assert "the wheels stand" in process.screen
    assert not (tmp_path / "robot.toml").exists()


@pytest.mark.nightly
async def test_killed_while_the_cable_is_out_the_guard_stops_the_wheel(board, terminal) -> None:
    robot, process = await unplugged(board, terminal)
    process.process.kill()
    assert await process.ended() == -signal.SIGKILL
    assert robot.turns()
    robot.do("replug")
    await eventually(robot.stands)


@pytest.mark.nightly
async def test_killed_while_the_board_hears_nothing_the_guard_stops_the_wheel_when_it_hears(
    board, terminal
) -> None:
    robot = None
    for _ in range(20):
        robot, process = await pulsing(board, terminal, robot)
        robot.do("loss 1")
        process.process.kill()
        if robot.turns():
            break
        # This test was held up for as long as the pulse was.
        robot.do("clear")
    await eventually(lambda: "no board answers" in process.written)
    assert robot.turns()
    robot.do("clear")
    await eventually(robot.stands)
