"""`yahboomd probe` on a real pty."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest

from yahboomd.cli.main import main

pytestmark = pytest.mark.realtime


def test_a_board_as_it_is_sold_is_named_and_ready(simulated_board, capsys) -> None:
    board = simulated_board("--ticks", "5000,0,-5000,0")
    assert main(["probe", "--port", board.port]) == 0
    output = capsys.readouterr()
    assert f"{board.port} -> {Path(board.port).resolve()}" in output.out
    assert "streamed dialect, firmware 1.7.3" in output.out
    # A busy machine may leave it unknown whether they survive.
    assert "the counters are lost" not in output.out
    assert "Ready to drive." in output.out
    assert output.err == ""
    # Not on a terminal: no escape sequences.
    assert "\x1b" not in output.out


def test_a_board_that_would_run_away_is_refused_then_mended_by_write(
    simulated_board, capsys
) -> None:
    board = simulated_board("--flash", "lines=0", "--flash", "motor_type=3")
    assert main(["probe", "--port", board.port]) == 1
    words = capsys.readouterr().out
    assert "Not to be driven like this." in words
    assert "0 as its encoder lines" in words
    assert "motor type 3" in words
    assert main(["probe", "--port", board.port, "--write"]) == 0
    words = capsys.readouterr().out
    assert "3 (TT with encoder) -> 1 (520)   stored" in words
    assert "0 -> 11   stored" in words
    assert "Ready to drive." in words
    assert main(["probe", "--port", board.port, "--write", "--json"]) == 0
    assert "stored" not in json.loads(capsys.readouterr().out)


def test_a_port_that_a_daemon_holds_is_described_by_the_daemon(
    real_robot, patience, capsys
) -> None:
    robot = real_robot()
    robot.daemon.says("Connected")
    options = ["--set", f'zenoh.listen=["{robot.endpoint}"]', "--set", "zenoh.connect=[]"]
    assert main(["probe", "--port", str(robot.port), *options]) == 0
    words = " ".join(capsys.readouterr().out.split())
    assert "streamed dialect, firmware 1.7.3" in words
    assert f"(pid {robot.daemon.process.pid})" in words


def test_another_reader_of_the_port_is_named(simulated_board, capsys) -> None:
    """Whether it takes every answer or some: the board is not called silent or unpowered."""
    port = simulated_board().port
    with subprocess.Popen(["cat", port], stdout=subprocess.DEVNULL) as reader:
        assert main(["probe", "--port", port]) != 0
        reader.kill()
    output = capsys.readouterr()
    words = " ".join((output.out + output.err).split())
    assert f"{port} is also open in cat (pid {reader.pid}). Two readers share" in words
    assert "supply connected" not in words


def test_what_is_no_port_is_explained(capsys) -> None:
    assert main(["probe", "--port", "/dev/null"]) == 69
    assert "Is the path right?" in capsys.readouterr().err
    assert main(["probe", "--port", "/nonexistent"]) == 69
    assert "/nonexistent: there is no such port." in capsys.readouterr().err


def test_the_list_opens_nothing(capsys) -> None:
    assert main(["probe", "--list"]) in {0, 69}
    assert capsys.readouterr().out
    assert main(["probe", "--list", "--json"]) in {0, 69}
    json.loads(capsys.readouterr().out)


def test_mistakes_in_the_configuration_are_said_before_anything_is_opened(capsys) -> None:
    assert main(["probe", "--port", "/nonexistent", "--set", "serial.baud=1"]) == 78
    assert "serial.baud" in capsys.readouterr().err
    assert main(["probe", "--port", "/nonexistent", "--write", "--pid", "1,-1,0"]) == 78
    assert "gains P, I, D" in capsys.readouterr().err
