"""`yahboomd probe` on a real pty."""

from __future__ import annotations

import asyncio
import json
import os
from pathlib import Path

import pytest
from real_robot import free_endpoint

from yahboomd import __version__
from yahboomd.cli.main import main
from yahboomd.core.link import latency_timer
from yahboomd.core.protocol.registry import DIALECTS

pytestmark = pytest.mark.realtime


def test_a_board_as_it_is_sold_is_named_and_ready(simulated_board, capsys) -> None:
    board = simulated_board("--ticks", "5000,0,-5000,0")
    assert main(["probe", "--port", board.port]) == 0
    output = capsys.readouterr()
    assert f"{board.port} -> {Path(board.port).resolve()}" in output.out
    assert "streamed dialect, firmware 1.7.3" in output.out
    assert "the counters survive closing and opening the port" in output.out
    assert "Ready to drive." in output.out
    assert output.err == ""
    # Not on a terminal: no escape sequences.
    assert "\x1b" not in output.out


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
    assert found["yahboomd"] == __version__
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
    words = capsys.readouterr().err
    assert f"(pid {board.owner.pid})" in words
    assert f"End the other: kill {board.owner.pid}" in words
    assert "use its bus instead" not in words
    assert main(["probe", "--write", "--port", board.port, *options]) == 69
    assert f"End the other: kill {board.owner.pid}" in capsys.readouterr().err
    assert not board.stands


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


def test_a_daemon_is_asked_for_its_board_where_no_port_is_named_or_found(
    real_robot, patience, capsys
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


def test_a_daemon_without_a_board_is_said_to_have_none(real_robot, patience, capsys) -> None:
    robot = real_robot()
    robot.daemon.says("Connected")
    robot.simulation.end()
    robot.daemon.says("went away")
    assert main(["probe", "--connect", robot.endpoint]) == 69
    words = capsys.readouterr().err
    assert f"The daemon at {robot.endpoint} has no board." in words
    assert "`yahboomd probe --list` the ports" in words
    assert "runs here: " not in words


def test_a_daemon_of_another_namespace_is_named_where_no_port_is_found(
    real_robot, patience, capsys, tmp_path, monkeypatch
) -> None:
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path / "run"))
    robot = real_robot(run=["--namespace", "bot1"])
    robot.daemon.says("Connected")
    nowhere = ["--set", "zenoh.connect=[]", "--set", f'zenoh.listen=["{free_endpoint()}"]']
    assert main(["probe", *nowhere]) == 69
    words = capsys.readouterr().err
    assert f"bot1 (pid {robot.daemon.process.pid}, {robot.port}) runs here: " in words
    assert f"probe --namespace bot1 --connect {robot.endpoint}`" in words
    assert "Plug the board in" not in words


def test_a_board_that_is_silent_is_said_so_with_what_to_check(simulated_board, capsys) -> None:
    board = simulated_board("--do", "hang")
    assert main(["probe", "--port", board.port]) == 69
    words = capsys.readouterr().err
    assert "no board answers (opened at 115200 baud, DTR on, RTS off). No byte came" in words


def test_garbage_points_to_the_baud_rate(simulated_board, capsys) -> None:
    board = simulated_board("--do", "babble 600")
    assert main(["probe", "--port", board.port, "--json"]) == 69
    assert "baud rate" in json.loads(capsys.readouterr().out)["error"]


def test_what_is_no_port_is_explained(capsys) -> None:
    assert main(["probe", "--port", "/dev/null"]) == 69
    assert "Is the path right?" in capsys.readouterr().err
    assert main(["probe", "--port", "/nonexistent"]) == 69
    assert "/nonexistent: there is no such port." in capsys.readouterr().err


def test_a_latency_timer_is_named_with_the_line_that_sets_it(
    simulated_board, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    board = simulated_board()
    timer = tmp_path / os.path.basename(os.path.realpath(board.port)) / "latency_timer"
    timer.parent.mkdir()
    timer.write_text("16\n")
    monkeypatch.setattr(latency_timer, "SYSFS", tmp_path)
    assert main(["probe", "--port", board.port, "--json"]) == 0
    advice = json.loads(capsys.readouterr().out)["advice"]
    assert any('ATTR{latency_timer}="1"' in each for each in advice)
    assert main(["probe", "--port", board.port]) == 0
    assert f"    {latency_timer.RULE}\n" in capsys.readouterr().out


def test_what_a_board_says_of_itself_commands_no_terminal(simulated_board, capsys) -> None:
    board = simulated_board("--firmware", "1.7.3\x1b[2J\x1b]0;mine\x07")
    assert main(["probe", "--port", board.port]) == 0
    output = capsys.readouterr()
    assert "firmware 1.7.3" in output.out
    assert all(line.isprintable() for line in (output.out + output.err).splitlines())
    assert main(["probe", "--port", board.port, "--json"]) == 0
    assert "\x1b" not in capsys.readouterr().out


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


def test_the_stored_values_of_no_profile_are_options_by_the_dialects_tables(capsys) -> None:
    with pytest.raises(SystemExit):
        main(["probe", "--help"])
    shown = " ".join(capsys.readouterr().out.split())
    rows = [row for dialect in DIALECTS.values() for row in dialect.settings if row.option]
    # Two boards store gains: the option is one, in the words of the first.
    assert [row.field for row in rows] == ["pid", "pid"]
    assert f"--pid P,I,D {rows[0].option}" in shown
    assert shown.count("--pid P,I,D") == 2


def test_gains_that_are_no_three_numbers_are_a_usage_error(capsys) -> None:
    with pytest.raises(SystemExit):
        main(["probe", "--pid", "1,2"])
    assert "three numbers" in capsys.readouterr().err
