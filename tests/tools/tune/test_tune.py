"""`yahboomd tune` as a process, on a real pty: refusals, ends by any signal, and leftovers."""

from __future__ import annotations

import argparse
import json
import os
import signal
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.parse import quote

import pytest
from process_priority import DAEMON_NICE, prefer
from real_robot import Process, wait_for
from simulated_board import SimulatedBoard
from tuning_bench import TuningBench

from yahboomd.cli.main import main
from yahboomd.cli.tune import TuneCommand
from yahboomd.core.errors import PortBusy, Refused
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.port.own_port import with_hints
from yahboomd.tools.tune.saved import read_saved

pytestmark = pytest.mark.realtime


@pytest.fixture
def tune(tmp_path: Path) -> Iterator[Callable[..., Process]]:
    processes: list[Process] = []

    def start(board: SimulatedBoard, *options: str) -> Process:
        words = ("tune", "--port", board.port, "--output", str(tmp_path / "steps.svg"), *options)
        processes.append(Process(*words, environ={"STATE_DIRECTORY": str(tmp_path)}))
        # It measures in real time, as a daemon drives.
        prefer(processes[-1].process, DAEMON_NICE)
        return processes[-1]

    yield start
    for each in processes:
        each.end()


def turning(board: SimulatedBoard) -> bool:
    return max(map(abs, board.speeds)) > 0.05


def begun(tune: Callable[..., Process], board: SimulatedBoard) -> Process:
    """A tuning that turns a wheel; another one, if a busy machine kept it from measuring."""

    def begin() -> Process | None:
        tuning = tune(board, "--yes")
        wait_for(lambda: turning(board) or tuning.process.poll() is not None, "a wheel turns")
        return tuning if tuning.process.poll() is None else None

    found: Process = wait_for(begin, "a tuning turns a wheel")
    return found


@pytest.mark.cases(1)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_a_signal_leaves_standing_wheels_and_an_untouched_board(
    simulated_board, tune, tmp_path, number
):
    board = simulated_board()
    tuning = begun(tune, board)
    tuning.process.send_signal(number)
    assert tuning.end_by_itself() == 128 + number, tuning.output
    assert board.stands
    assert "the wheels were stopped" in tuning.output
    assert not list(tmp_path.glob("before-tune*"))


@pytest.mark.nightly
def test_killed_among_its_writes_the_wheels_stand_and_undo_restores_the_board(
    simulated_board, tune, tmp_path
):
    board = simulated_board("--flash", "p=0.3", "--flash", "i=0.6", "--flash", "d=0")

    def wrote() -> Process | None:
        tuning = tune(board, "--yes")
        try:
            tuning.says("gains P, I, D")
        except ChildProcessError:
            # A busy machine may hold the board up long enough for it to count as silent.
            assert tuning.end_by_itself() == os.EX_UNAVAILABLE, tuning.output
            return None
        return tuning

    tuning = wait_for(wrote, "gains are tried")
    wait_for(lambda: turning(board), "a wheel turns with the new gains")
    tuning.process.kill()
    wait_for(lambda: board.stands, "the wheels stand")
    (path,) = tmp_path.glob("before-tune*.json")
    found = read_saved(path).settings
    assert (found["pid"], found["deadzone"]) == ((0.3, 0.6, 0.0), 1600)
    assert not read_saved(path).finished
    # The guard has the port for a second yet: that is awaited.
    undoing = tune(board, "--undo")
    assert undoing.end_by_itself() == 0, undoing.output
    assert "dead zone 1600. Values written: 2." in undoing.output
    assert not path.exists()


@pytest.mark.nightly
def test_the_cable_out_in_a_step_is_waited_for_and_the_wheels_are_stopped(
    simulated_board, tune, tmp_path
):
    control = tmp_path / "control"
    board = simulated_board("--control", str(control))

    def unplugged() -> Process | None:
        tuning = begun(tune, board)
        tell(control, "unplug")
        tuning.says("went away")
        if "Plug the board in again" in tuning.output:
            return tuning
        # Between two movements.
        tell(control, "replug")
        return None

    tuning = wait_for(unplugged, "the cable comes out while a wheel turns")
    assert turning(board)
    tell(control, "replug")
    assert tuning.end_by_itself() == os.EX_TEMPFAIL, tuning.output
    assert board.stands
    assert "the wheels stand" in tuning.output


def tell(control: Path, command: str) -> None:
    """Tell the simulated board something."""
    with socket.socket(socket.AF_UNIX) as console:
        console.connect(str(control))
        console.sendall(f"{command}\n".encode())
        assert console.recv(99).startswith(b"ok")


@pytest.mark.nightly
@pytest.mark.cases(1)
@pytest.mark.parametrize("suspended", [False, True])
def test_stop_in_a_second_terminal_ends_it_and_sees_the_wheels_stand(
    simulated_board, tune, suspended
):
    board = simulated_board()
    tuning = begun(tune, board)
    held = str(with_hints(PortBusy(f"{board.port} is held."), board.port))
    assert "`yahboomd stop` ends it, and sees them stand." in held
    assert held.endswith(f"End the other: kill {tuning.process.pid}")
    if suspended:
        tuning.process.send_signal(signal.SIGSTOP)
    stop = Process("stop", "--port", board.port)
    assert stop.end_by_itself() == 0, stop.output
    assert board.stands
    assert "yahboomd tune` is ended by `" in stop.output
    assert "The wheels stand." in stop.output
    assert tuning.end_by_itself() == 128 + signal.SIGTERM, tuning.output
    assert "Ended by SIGTERM: the wheels were stopped" in tuning.output


@pytest.mark.nightly
@on_virtual_time
async def test_a_dry_run_measures_suggests_and_writes_nothing(tmp_path, capsys) -> None:
    bench, picture = TuningBench("520", "oscillates"), tmp_path / "steps.svg"
    before = bench.link.robot.board.flash
    args = argparse.Namespace(yes=True, dry_run=True, json=True, output=picture, speed=0.4)
    tuning = TuneCommand(args, bench.config, "/dev/simulated", tmp_path / "saved")
    assert await tuning.tune(bench.procedure()) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["writes"] == 0
    assert found["stored_now"] == found["stored_before"]
    assert bench.link.robot.board.flash == before
    assert found["suggested"]["pid"][2] == 0.0
    assert [wheel["name"] for wheel in found["wheels"]] == ["left", "right"]
    assert all(wheel["before"]["overshoot"] > 0.2 for wheel in found["wheels"])
    assert picture.read_text().startswith("<?xml")
    assert found["picture"] == str(picture)
    assert not (tmp_path / "saved").exists()


def test_while_the_emergency_stop_is_engaged_no_wheel_turns(
    simulated_board, tmp_path, monkeypatch, capsys
):
    board = simulated_board()
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    (tmp_path / f"estop@{quote(board.port, safe='')}").write_text("")
    for options in (["--yes"], ["--undo"]):
        assert main(["tune", "--port", board.port, *options]) == 1
        assert "emergency stop is engaged" in capsys.readouterr().err
    assert board.stands


def test_unless_the_person_says_that_the_wheels_are_in_the_air_none_turns(
    simulated_board, tmp_path, monkeypatch, capsys
):
    board = simulated_board()
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    read, write = os.pipe()
    os.write(write, b"no\n")
    os.close(write)
    with os.fdopen(read) as answers:
        monkeypatch.setattr("sys.stdin", answers)
        assert main(["tune", "--port", board.port]) == 1
    assert "The wheels have to be in the air" in capsys.readouterr().err
    assert board.stands


@pytest.mark.parametrize(
    ("name", "words"), [("steps.txt", "is no picture"), ("no/steps.png", "There is no folder")]
)
def test_a_picture_that_cannot_be_is_refused_before_a_wheel_turns(tmp_path, capsys, name, words):
    assert main(["tune", "--yes", "--port", "/dev/null", "--output", str(tmp_path / name)]) == 1
    assert words in capsys.readouterr().err


@pytest.mark.cases(1)
@pytest.mark.parametrize("as_json", [False, True])
@on_virtual_time
async def test_where_the_picture_is_not_written_the_figures_are_shown(
    tmp_path, capsys, as_json
) -> None:
    # Of a board that stores no gains, which is measured in a tenth of the time.
    bench, picture = TuningBench(dialect="polled"), tmp_path / "steps.svg"
    picture.symlink_to("/dev/full")
    args = argparse.Namespace(yes=True, dry_run=True, json=as_json, output=picture, speed=0.4)
    tuning = TuneCommand(args, bench.config, "/dev/simulated", tmp_path / "saved")
    try:
        status = await tuning.tune(bench.procedure())
        words = json.loads(capsys.readouterr().out)["error"]
    except Refused as error:
        status, words = error.exit_code, str(error)
        assert "no gains" in capsys.readouterr().out
    assert status == 1
    assert "No space left on device" in words
