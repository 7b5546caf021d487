"""`yahboomd probe` on a real pty."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest
from real_robot import free_endpoint

from yahboomd.cli.main import main

pytestmark = pytest.mark.realtime


def test_a_board_as_it_is_sold_is_named_and_ready(simulated_board, capsys) -> None:
    board = simulated_board("--ticks", "5000,0,-5000,0")
    assert main(["probe", "--port", board.port]) == 0
    told = capsys.readouterr()
    assert f"{board.port} -> {Path(board.port).resolve()}" in told.out
    assert "streamed dialect, firmware 1.7.3" in told.out
    assert "the counters survive closing and opening the port" in told.out
    assert "Ready to drive." in told.out
    assert told.err == ""
    # Not on a terminal: no escape sequences.
    assert "\x1b" not in told.out


def test_a_polled_board_is_named_and_says_that_it_stores_nothing(simulated_board, capsys) -> None:
    board = simulated_board("--dialect", "polled", "--ticks", "5000,0,-5000,0")
    assert main(["probe", "--port", board.port, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["dialect"], found["ticks"], found["reopen"]) == (
        "polled",
        [5000, 0, -5000, 0],
        "kept",
    )
    assert "settings" not in found
    assert main(["probe", "--port", board.port, "--write"]) == 0
    assert "Nothing was stored: the board shows no settings." in capsys.readouterr().out


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


async def test_a_person_who_says_no_stores_nothing(simulated_board, terminal, capsys) -> None:
    board = simulated_board()
    process = terminal("probe", "--port", board.port, "--write")
    await process.shows("Store this value in the board's flash? [y/N]")
    process.type("n\n")
    assert await process.ended() == 0
    await process.shows("Nothing was stored.")
    assert await asyncio.to_thread(main, ["probe", "--port", board.port, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["settings"]
    assert next(row["have"] for row in rows if row["command"] == "deadzone") == 1600


def test_new_gains_are_stored_when_asked_for(simulated_board, capsys) -> None:
    board = simulated_board("--flash", "dead_zone=1900")
    assert main(["probe", "--port", board.port, "--write", "--pid", "1,0.1,0.4", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [(value["command"], value["outcome"]) for value in found["stored"]] == [
        ("MPID", "stored")
    ]


def test_a_held_port_without_a_daemon_names_its_holder(simulated_board, capsys) -> None:
    board = simulated_board()
    board.drive()
    endpoint = free_endpoint()
    options = ["--set", f'zenoh.listen=["{endpoint}"]', "--set", "zenoh.connect=[]"]
    assert main(["probe", "--port", board.port, *options]) == 69
    assert f"(pid {board.owner.pid})" in capsys.readouterr().err
    assert not board.stands


def test_a_port_that_a_daemon_holds_is_described_by_the_daemon(real_robot, capsys) -> None:
    robot = real_robot()
    robot.daemon.says("Connected")
    options = ["--set", f'zenoh.listen=["{robot.endpoint}"]', "--set", "zenoh.connect=[]"]
    assert main(["probe", "--port", str(robot.port), *options]) == 0
    words = " ".join(capsys.readouterr().out.split())
    assert "streamed dialect, firmware 1.7.3" in words
    assert f"(pid {robot.daemon.process.pid})" in words


def test_a_daemon_is_asked_for_its_board_where_no_port_is_named_or_found(
    real_robot, capsys
) -> None:
    robot = real_robot()
    robot.daemon.says("Connected")
    options = ["--set", f'zenoh.listen=["{robot.endpoint}"]', "--set", "zenoh.connect=[]"]
    assert main(["probe", *options]) == 0
    words = " ".join(capsys.readouterr().out.split())
    assert f"port {robot.port}" in words
    assert f"(pid {robot.daemon.process.pid})" in words
    # But nothing is stored on a board that another program drives.
    assert main(["probe", "--write", "--yes", *options]) == 69
    assert "Plug the board in" in capsys.readouterr().err


def test_a_board_that_is_silent_is_said_so_with_what_to_check(simulated_board, capsys) -> None:
    board = simulated_board("--do", "hang")
    assert main(["probe", "--port", board.port]) == 69
    words = capsys.readouterr().err
    assert "no board answers (opened at 115200 baud, DTR on, RTS off). Not a byte came" in words


def test_garbage_points_to_the_baud_rate(simulated_board, capsys) -> None:
    board = simulated_board("--do", "babble 600")
    assert main(["probe", "--port", board.port, "--json"]) == 69
    assert "baud rate" in json.loads(capsys.readouterr().out)["error"]


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
    assert "PID" in capsys.readouterr().err


def test_gains_that_are_no_three_numbers_are_a_usage_error(capsys) -> None:
    with pytest.raises(SystemExit):
        main(["probe", "--pid", "1,2"])
    assert "three numbers" in capsys.readouterr().err
