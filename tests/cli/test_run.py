from __future__ import annotations

import os
import signal
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from real_robot import Process, free_endpoint, wait_for

from yahboomd.cli.main import main
from yahboomd.core.daemon.service import Daemon
from yahboomd.tools.stop.unresponsive import process_state

pytestmark = pytest.mark.realtime


@pytest.fixture
def alone(tmp_path: Path) -> list[str]:
    """Options of a daemon that meets no other one."""
    sets = (
        f'zenoh.listen=["{free_endpoint()}"]',
        "zenoh.connect=[]",
        f"estop.latch_file={tmp_path / 'estop'}",
    )
    return [word for each in sets for word in ("--set", each)]


@pytest.fixture
def started(alone: list[str]) -> Iterator[Callable[..., Process]]:
    running: list[Process] = []

    def start(*arguments: str, **environ: str) -> Process:
        running.append(Process("run", *arguments, *alone, environ=environ))
        return running[-1]

    yield start
    for each in running:
        each.end()


@pytest.mark.cases(1)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_every_polite_signal_ends_it_well(
    started: Callable[..., Process], number: signal.Signals
) -> None:
    daemon = started("--port", "/dev/not-there")
    daemon.says("/dev/not-there: there is no such port.")
    assert daemon.end(number) == 0
    assert f"{number.name}: stopping the wheels" in daemon.output
    assert "Traceback" not in daemon.output


def test_port_and_namespace_are_options_of_their_own(
    alone: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[Daemon] = []

    async def run(daemon: Daemon) -> None:
        seen.append(daemon)

    monkeypatch.setattr(Daemon, "run", run)
    arguments = ["run", "--port", "/dev/robot", "--namespace", "bot7", *alone]
    assert main(arguments) == os.EX_OK
    (daemon,) = seen
    assert daemon._config.serial.port == "/dev/robot"
    assert daemon._config.zenoh.namespace == "bot7"


def test_a_bug_ends_it_with_its_traceback_and_a_status_of_its_own(
    alone: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    async def run(_daemon: Daemon) -> None:
        raise BaseExceptionGroup("tasks", [ZeroDivisionError("a bug")])

    monkeypatch.setattr(Daemon, "run", run)
    assert main(["run", *alone]) == os.EX_SOFTWARE
    said = capsys.readouterr().err
    assert "a stop was sent to the wheels" in said
    assert "ZeroDivisionError: a bug" in said


@pytest.mark.cases(1)
@pytest.mark.parametrize("frozen", [False, True])
def test_a_second_daemon_on_the_listen_port_names_the_command_that_ends_the_first(
    started: Callable[..., Process], frozen: bool
) -> None:
    first = started("--port", "/dev/not-there", "--no-guard")
    first.says("Listening")
    pid = first.process.pid
    if frozen:
        first.process.send_signal(signal.SIGSTOP)
        wait_for(lambda: process_state(pid) == "T", "it is frozen")
    second = started("--port", "/dev/not-there-either")
    assert second.end_by_itself() == 69
    assert f"yahboomd (pid {pid}) listens there already." in second.output
    wanted = f"`kill -CONT {pid}`, or end it: kill -9 {pid}" if frozen else f"End it: kill {pid}"
    assert wanted in second.output
    first.process.send_signal(signal.SIGCONT)


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", ["streamed", "polled"])
def test_wheels_that_a_crash_left_turning_are_stopped_where_the_bus_cannot_be_opened(
    started: Callable[..., Process], simulated_board, dialect: str
) -> None:
    first = started("--port", "/dev/not-there")
    first.says("Listening")
    board = simulated_board("--dialect", dialect)
    board.drive()
    board.kill_owner()
    assert not board.stands
    second = started("--port", board.port)
    assert second.end_by_itself() == os.EX_UNAVAILABLE
    wait_for(lambda: board.stands, "the wheels stand")


def test_a_zenoh_file_that_cannot_be_used_ends_a_service_as_config_check_does(
    started: Callable[..., Process], tmp_path: Path
) -> None:
    file = tmp_path / "zenoh.json5"
    file.write_text("{ transport: { unicast: { lowlatency: true } } }")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        notify = manager.getsockname()
        arguments = ("--port", "/dev/not-there", "--set", f"zenoh.config={file}")
        ended = started(*arguments, NOTIFY_SOCKET=notify)
        assert ended.end_by_itself() == os.EX_CONFIG, ended.output
    assert f"{file} cannot be used: transport/unicast/lowlatency: " in ended.output


@pytest.mark.nightly
def test_wheels_that_a_crash_left_turning_are_stopped_as_soon_as_their_port_is_there(
    started: Callable[..., Process], simulated_board, tmp_path: Path
) -> None:
    """A computer that starts again: neither network nor port are there at first."""
    first = started("--port", "/dev/not-there")
    first.says("Listening")
    board = simulated_board()
    board.drive()
    board.kill_owner()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        port = tmp_path / "late"
        second = started("--port", str(port), NOTIFY_SOCKET=manager.getsockname())
        second.says("yahboomd keeps trying")
        assert not board.stands
        port.symlink_to(board.port)
        wait_for(lambda: board.stands, "the wheels stand")
        second.process.send_signal(signal.SIGTERM)
        second.end_by_itself()
    assert "Traceback" not in second.output
