"""`yahboomd stop` on a real pty, beside real processes."""

from __future__ import annotations

import argparse
import os
import shlex
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from real_robot import free_endpoint, wait_for

from yahboomd.cli import stop
from yahboomd.cli.main import main, whole_parser
from yahboomd.core.errors import PortMissing
from yahboomd.core.link import discovery, port_note
from yahboomd.core.link.line import ReceivedSample
from yahboomd.core.link.port_identity import identify
from yahboomd.core.link.port_note import PortNote
from yahboomd.core.link.takeover import TakeoverReport
from yahboomd.core.protocol.dialect import FramerCounters
from yahboomd.tools.stop import stop_local
from yahboomd.tools.stop.stop_port import describe
from yahboomd.tools.stop.unresponsive import process_state

pytestmark = pytest.mark.realtime

IMPATIENT = """
import os, signal, sys
from yahboomd.tools.stop import stop_port
from yahboomd.tools.stop import stop_local
from yahboomd.cli.main import main
seize = stop_port.seize
def impatient(*arguments, **options):
    seized = seize(*arguments, **options)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP):
        os.kill(os.getpid(), number)
    return seized
stop_port.seize = impatient
sys.exit(main(["stop", "--direct", "--port", sys.argv[1]]))
"""


def alone(endpoint: str = "") -> tuple[str, ...]:
    """An empty bus, unless a daemon's endpoint is named."""
    endpoint = endpoint or free_endpoint()
    return ("--set", f'zenoh.listen=["{endpoint}"]', "--set", "zenoh.connect=[]")


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", ["streamed", "polled"])
def test_after_sigkill_of_the_process_that_drove_a_direct_stop_brings_the_true_wheels_to_rest(
    simulated_board, yahboomd, dialect
) -> None:
    board = simulated_board("--dialect", dialect)
    board.drive()
    board.kill_owner()
    # The board has no timeout: nothing has stopped it.
    assert not board.stands
    done = yahboomd("stop", "--direct", "--port", board.port)
    assert board.stands
    assert done.returncode == 0, done.stderr
    assert f"({dialect} board): the wheels stand, " in done.stdout
    assert done.stderr == ""


@pytest.mark.nightly
def test_a_held_port_names_its_holder_and_how_to_end_it(simulated_board, capsys) -> None:
    board = simulated_board()
    board.drive()
    assert main(["stop", "--direct", "--port", board.port]) == 69
    words = capsys.readouterr().err
    assert f"(pid {board.owner.pid})" in words
    assert f"kill {board.owner.pid}" in words
    assert not board.stands


@pytest.mark.nightly
def test_without_a_daemon_the_port_itself_is_stopped(simulated_board, capsys) -> None:
    board = simulated_board()
    board.drive()
    board.kill_owner()
    assert main(["stop", "--port", board.port, *alone()]) == 0
    assert board.stands
    assert "the wheels stand" in capsys.readouterr().out


@pytest.mark.nightly
def test_the_note_of_a_killed_daemon_leads_to_the_port_without_the_configuration(
    simulated_board, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    board = simulated_board()
    board.drive()
    board.kill_owner()
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    port_note.write(note_of(board.port), str(tmp_path))
    config = tmp_path / "config.toml"
    config.write_text("this is no TOML")
    assert main(["stop", "--direct", "--config", str(config)]) == 0
    assert board.stands
    assert capsys.readouterr().err == ""


def note_of(path: str | Path) -> PortNote:
    return PortNote(str(path), 115200, True, False, False, identify(os.stat(path)))


def test_a_name_that_udev_gave_away_leads_to_the_board_all_the_same(
    simulated_board, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    board, other = simulated_board(), simulated_board()
    for each in (board, other):
        each.drive()
        each.kill_owner()
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    name = tmp_path / "yahboom_driver"
    name.symlink_to(os.path.realpath(board.port))
    port_note.write(note_of(name), str(tmp_path))
    name.unlink()
    name.symlink_to(os.path.realpath(other.port))
    assert main(["stop", "--direct", "--config", str(tmp_path / "none.toml")]) == 0
    assert board.stands
    assert not other.stands
    words = capsys.readouterr().err
    assert f"{name} no longer leads to the board" in words
    assert os.path.realpath(board.port) in words


@pytest.mark.nightly
def test_another_device_under_the_name_of_a_board_that_is_gone_is_left_alone(
    simulated_board, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    board, other = simulated_board(), simulated_board()
    other.drive()
    other.kill_owner()
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    name = tmp_path / "yahboom_driver"
    name.symlink_to(os.path.realpath(board.port))
    port_note.write(note_of(name), str(tmp_path))
    board.process.end()
    name.unlink()
    name.symlink_to(os.path.realpath(other.port))
    config = tmp_path / "config.toml"
    config.write_text(f'[serial]\nport = "{name}"\n')
    assert main(["stop", "--direct", "--config", str(config)]) == os.EX_UNAVAILABLE
    assert not other.stands
    words = capsys.readouterr().err
    assert "is another device than the one that the daemon drove" in words
    assert "Nothing was sent to the other one" in words
    assert "stop --port" in words


@pytest.mark.nightly
def test_a_note_of_a_port_that_is_gone_does_not_keep_the_wheels_turning(
    simulated_board, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    board = simulated_board()
    board.drive()
    board.kill_owner()
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    noted = note_of(board.port)
    assert noted.device is not None
    away = noted.device._replace(number=os.makedev(188, 0), node="gone")
    gone = noted._replace(path=str(tmp_path / "gone"), device=away)
    port_note.write(gone, str(tmp_path))
    config = tmp_path / "config.toml"
    config.write_text(f'[serial]\nport = "{board.port}"\n')
    assert main(["stop", "--direct", "--config", str(config)]) == 0
    assert board.stands


@pytest.mark.nightly
def test_a_broken_configuration_does_not_keep_the_wheels_turning(
    simulated_board, tmp_path: Path, capsys
) -> None:
    board = simulated_board()
    board.drive()
    board.kill_owner()
    config = tmp_path / "config.toml"
    config.write_text("[serial]\nbaud = 9600\n")
    assert main(["stop", "--direct", "--port", board.port, "--config", str(config)]) == 0
    assert board.stands
    words = capsys.readouterr().err
    assert "serial.baud" in words
    assert "This stop used nothing but the port" in words


@pytest.mark.nightly
def test_the_port_of_the_configuration_is_taken_whatever_is_wrong_with_the_rest(
    simulated_board, tmp_path: Path, capsys
) -> None:
    board = simulated_board()
    config = tmp_path / "robot.toml"
    config.write_text(f'[serial]\nport = "{board.port}"\n[zenoh]\nlisten = 5\n')
    for options in (["--set", f"serial.port={board.port}"], ["--config", str(config)]):
        board.drive()
        board.kill_owner()
        assert main(["stop", "--direct", *options]) == 0
        assert board.stands
    words = capsys.readouterr().err
    assert words.count("zenoh.listen") == 1
    assert "This stop used nothing but the port" in words


@pytest.mark.nightly
def test_wheels_that_something_else_turns_end_with_1(simulated_board, capsys) -> None:
    board = simulated_board("--do", "turning left")
    assert main(["stop", "--direct", "--port", board.port]) == 1
    assert "the wheels still turn" in capsys.readouterr().err


def test_a_port_that_is_missing_is_said_so_and_so_is_the_daemon(capsys) -> None:
    endpoint = free_endpoint()
    assert main(["stop", "--port", "/nonexistent/port", *alone(endpoint)]) == 69
    words = capsys.readouterr().err
    assert f"No daemon answers at {endpoint}, and /nonexistent/port: there is no" in words


def test_a_daemon_that_is_missing_below_a_namespace_is_said_so(capsys) -> None:
    endpoint = free_endpoint()
    options = ["--port", "/nonexistent/port", "--namespace", "bot1", *alone(endpoint)]
    assert main(["stop", *options]) == 69
    assert f"at {endpoint} below the namespace 'bot1', and " in capsys.readouterr().err


@pytest.mark.nightly
def test_impatience_does_not_interrupt_a_stop(simulated_board) -> None:
    board = simulated_board()
    board.drive()
    board.kill_owner()
    done = subprocess.run([sys.executable, "-c", IMPATIENT, board.port], check=False, timeout=60)
    assert done.returncode == 0
    assert board.stands


def test_a_running_daemon_is_stopped_and_drives_again_when_it_is_released(
    real_robot, patience, capsys, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path / "run"))
    robot = real_robot(guarded=True)
    options = ["--port", str(robot.port), *alone(robot.endpoint)]
    robot.daemon.says("Connected")
    wait_for(lambda: main(["stop", *options]) == 0, "the daemon reports standing wheels")
    assert "The wheels stand. To drive again: yahboomd stop --release" in capsys.readouterr().out
    assert main(["stop", "--release", *options]) == 0
    words = capsys.readouterr().out
    pid = robot.daemon.process.pid
    assert words.startswith(f"yahboomd (pid {pid}, {robot.port}): Released the emergency stop")


@pytest.mark.nightly
def test_a_suspended_daemon_is_named_by_release_and_by_stop_and_no_other_is_offered(
    real_robot, capsys, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # It is asked twice, and never answers.
    monkeypatch.setattr(stop_local, "STATUS_WITHIN_S", 10.0)
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path / "run"))
    robot, other = real_robot(), real_robot()
    for each in (robot, other):
        each.daemon.says("Connected")
    pid, port = robot.daemon.process.pid, str(robot.port)
    robot.daemon.process.send_signal(signal.SIGTSTP)
    wait_for(lambda: process_state(pid) == "T", "it is suspended")
    options = ["--port", port, *alone(robot.endpoint)]
    assert main(["stop", "--release", *options]) == 69
    words = capsys.readouterr().err
    assert f"yahboomd (pid {pid}) is suspended and cannot answer. " in words
    assert f"`kill -CONT {pid}`, then repeat: yahboomd stop --release --port {port} " in words
    assert f"pid {other.daemon.process.pid}" not in words
    # It has let the port go, so the wheels can be stopped there.
    assert main(["stop", *options]) == 0
    output = capsys.readouterr()
    assert "the wheels stand" in output.out
    assert f"pid {other.daemon.process.pid}" not in output.err
    robot.daemon.process.send_signal(signal.SIGCONT)
    # With a place named, no daemon elsewhere is offered.
    nowhere = free_endpoint()
    assert main(["stop", "--release", "--connect", nowhere]) == 69
    assert "runs here" not in capsys.readouterr().err


@pytest.mark.nightly
def test_a_program_that_also_reads_the_port_is_named_with_how_to_end_it(
    simulated_board, capsys
) -> None:
    board = simulated_board()
    with subprocess.Popen(["cat", board.port], stdout=subprocess.DEVNULL) as reader:
        wait_for(lambda: stop_local.holds(reader.pid, board.port), "it has the port open")
        # As if it had taken every answer.
        said = describe(
            TakeoverReport(
                port=str(board.port),
                dialect=None,
                stood=None,
                cut=False,
                within_s=1.0,
                heard=ReceivedSample(counters=FramerCounters()),
            )
        )
        reader.kill()
    assert f"but cat (pid {reader.pid}) also reads this port" in said
    assert f"End it: kill {reader.pid}; then yahboomd stop --port {board.port}" in said


@pytest.mark.nightly
def test_a_daemon_that_does_not_answer_is_no_success_beside_a_port_that_was_stopped(
    simulated_board, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    board = simulated_board()
    board.drive()
    board.kill_owner()
    with socket.socket(socket.AF_UNIX) as frozen:
        frozen.bind(str(tmp_path / "stop.sock"))
        frozen.listen(8)
        monkeypatch.setattr(stop_local, "sockets", lambda _: [str(tmp_path / "stop.sock")])
        # As if it had this port, too.
        monkeypatch.setattr(stop_local, "holds", lambda *_: True)
        monkeypatch.setattr(stop_local, "STATUS_WITHIN_S", 0.2)
        assert main(["stop", "--port", board.port, *alone()]) == 1
    assert board.stands
    output = capsys.readouterr()
    assert "the wheels stand" in output.out
    assert f"yahboomd (pid {os.getpid()}) does not answer (state " in output.err
    assert f"kill -9 {os.getpid()}; " in output.err


def test_a_broken_configuration_is_reported_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    def none_found(*_: object) -> str:
        raise PortMissing("no board is plugged in.")

    monkeypatch.setattr(stop_local, "sockets", lambda _: [])
    monkeypatch.setattr(discovery, "choose", none_found)
    # This test leaves alone a daemon at the default endpoint.
    endpoint = free_endpoint()
    monkeypatch.setattr(stop, "daemon_endpoints", lambda *_: (endpoint,))
    config = tmp_path / "config.toml"
    config.write_text("[serial]\nbaud = 9600\n")
    assert main(["stop", "--config", str(config)]) == 69
    assert capsys.readouterr().err.count("Stopping with the defaults") == 1


@pytest.mark.nightly
def test_asked_for_elsewhere_the_port_here_is_left_alone(simulated_board, capsys) -> None:
    board = simulated_board()
    board.drive()
    board.kill_owner()
    endpoint = free_endpoint()
    assert main(["stop", "--connect", endpoint, "--port", board.port]) == 69
    assert f"No daemon answers at {endpoint}." in capsys.readouterr().err
    assert not board.stands


def test_the_help_says_that_a_stop_which_names_nothing_ends_every_setup_and_tune(capsys) -> None:
    with pytest.raises(SystemExit):
        main(["stop", "--help"])
    words = " ".join(capsys.readouterr().out.split())
    assert "names nothing also ends every `setup` and `tune` of this machine" in words


def parsed(*words: str) -> argparse.Namespace:
    return whole_parser().parse_args(["stop", *words])


def test_a_named_port_needs_no_configuration_unless_one_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    port = ("--port", "/dev/board")
    assert stop._needs_no_configuration(parsed(*port))
    assert not stop._needs_no_configuration(parsed())
    assert not stop._needs_no_configuration(parsed(*port, "--set", "serial.dtr=false"))
    assert not stop._needs_no_configuration(parsed(*port, "--config", "robot.toml"))
    monkeypatch.setenv("YAHBOOMD_SERIAL__DTR", "false")
    assert not stop._needs_no_configuration(parsed(*port))


def test_the_command_to_repeat_has_every_option_that_was_given() -> None:
    words = ["--release", "--namespace", "bot 1", "--connect", "tcp/x:1", "--connect", "tcp/y:1"]
    words += ["--port", "/dev/a", "--set", "log.level=debug"]
    asked = stop._asked(parsed(*words))
    repeated = shlex.split(asked.again)
    assert repeated[:2] == ["yahboomd", "stop"]
    assert parsed(*repeated[2:]) == parsed(*words)
    assert asked[:3] == ("/dev/a", "bot 1", ("tcp/x:1", "tcp/y:1"))
