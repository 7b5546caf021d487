"""`make run`: a daemon on a simulated board, or on a real port."""

from __future__ import annotations

import importlib.util
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from real_robot import Client, free_endpoint, wait_for

pytestmark = pytest.mark.realtime

SCRIPT = Path(__file__).resolve().parents[2] / "make" / "make_run.py"


class MakeRun:
    def __init__(self, *arguments: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, str(SCRIPT), *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.lines: list[str] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        self.lines.extend(iter(self.process.stdout.readline, ""))

    @property
    def output(self) -> str:
        return "".join(self.lines)

    def end(self) -> int:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        status = self.process.wait(60)
        # Its children hold the pipe as long as they live.
        self._reader.join(60)
        assert not self._reader.is_alive(), "the board or the daemon lives on"
        assert self.process.stdout is not None
        self.process.stdout.close()
        return status


@pytest.fixture
def started(tmp_path: Path) -> Iterator[Callable[..., tuple[MakeRun, str]]]:
    running: list[MakeRun] = []

    def start(*arguments: str, latch: bool = True) -> tuple[MakeRun, str]:
        endpoint = free_endpoint()
        settings = [f'zenoh.listen=["{endpoint}"]', "zenoh.connect=[]"]
        if latch:
            settings.append(f"estop.latch_file={tmp_path / 'estop'}")
        sets = [word for each in settings for word in ("--set", each)]
        page = () if "--listen" in arguments else ("--listen", "127.0.0.1:0")
        running.append(MakeRun(*arguments, *page, *sets))
        return running[-1], endpoint

    yield start
    for each in running:
        each.end()


def test_without_a_port_a_board_is_simulated_and_the_robot_can_be_driven(
    started: Callable[..., tuple[MakeRun, str]], client: Callable[..., Client]
) -> None:
    made, endpoint = started()
    app = client("client", endpoint)
    app.in_state("standing")
    app.drive_until(b'{"vx": 0.3}', lambda: app.latest("pose")["x"] > 0.05, "it moved")
    wait_for(lambda: ".venv/bin/yahboomd drive" in made.output, "the invitation")
    wait_for(lambda: "The page is at http://127.0.0.1:" in made.output, "the page")
    wait_for(lambda: f"{endpoint} answers" in made.output, "the page found its daemon")
    wait_for(lambda: children(made.process.pid, "moves"), "moves are served")
    app.in_state("standing")
    assert made.end() == 0, made.output
    assert "Traceback" not in made.output


def test_a_taken_port_of_the_page_is_named_with_what_fits_make() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        done = subprocess.run(
            [sys.executable, str(SCRIPT), "--listen", f"127.0.0.1:{port}"],
            capture_output=True,
            text=True,
            check=False,
        )
    assert done.returncode == 69
    assert f"make run ARGS='--listen 127.0.0.1:{port + 1}'" in done.stderr
    assert done.stdout == ""


@pytest.mark.nightly
def test_a_daemon_works_on_when_its_page_dies_and_a_page_for_phones_needs_a_link(
    started: Callable[..., tuple[MakeRun, str]],
    client: Callable[..., Client],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    made, endpoint = started("--listen", "0.0.0.0:0")
    app = client("client", endpoint)
    app.in_state("standing")
    wait_for(lambda: "yahboomd web --show-link" in made.output, "how to see the link")
    (page,) = children(made.process.pid, "web")
    os.kill(page, signal.SIGKILL)
    app.drive_until(b'{"vx": 0.3}', lambda: app.latest("pose")["x"] > 0.05, "it moved")
    assert made.end() == 0


def children(pid: int, command: str) -> list[int]:
    """The processes that one started with this command of yahboomd."""
    found = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [
        int(each)
        for each in found
        if Path(f"/proc/{each}/cmdline").read_bytes().split(b"\0")[3:4] == [command.encode()]
    ]


@pytest.mark.nightly
@pytest.mark.parametrize("preset", ["4wd", "mecanum"])
def test_the_simulated_board_has_the_motors_of_the_configuration(
    started: Callable[..., tuple[MakeRun, str]],
    client: Callable[..., Client],
    tmp_path: Path,
    preset: str,
) -> None:
    config = tmp_path / "robot.toml"
    base = "wheel_base_m = 0.17\n" if preset == "mecanum" else ""
    config.write_text(f'[chassis]\npreset = "{preset}"\nwheel_separation_m = 0.17\n{base}')
    made, endpoint = started("--config", str(config))
    app = client("client", endpoint)
    app.in_state("standing")
    app.drive_until(b'{"vx": 0.3}', lambda: app.latest("pose")["x"] > 0.1, "it moved")
    wait_for(lambda: all(ticks > 0 for ticks in app.latest("wheels")["ticks"]), "all wheels turn")
    assert len(app.latest("wheels")["names"]) == 4
    assert app.latest("status")["state"] != "fault"
    assert made.end() == 0


@pytest.mark.nightly
def test_the_emergency_stop_of_a_simulated_robot_goes_with_it(
    started: Callable[..., tuple[MakeRun, str]], client: Callable[..., Client]
) -> None:
    made, endpoint = started(latch=False)
    app = client("client", endpoint)
    app.in_state("standing")
    assert app.ask("yahboomd/estop")["success"]
    latch = Path(app.ask("yahboomd/config")["data"]["estop"]["latch_file"])
    assert latch.exists()
    assert made.end() == 0
    assert not latch.parent.exists()


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["SIGHUP", "SIGQUIT", "SIGUSR1"])
def test_a_signal_ends_the_daemon_first_and_leaves_no_board_behind(
    started: Callable[..., tuple[MakeRun, str]], client: Callable[..., Client], name: str
) -> None:
    made, endpoint = started()
    client("client", endpoint).in_state("standing")
    number = getattr(signal, name)
    made.process.send_signal(number)
    made.process.send_signal(number)
    made.process.wait(60)
    # Nothing holds the pipe any more: daemon and board are gone.
    assert made.end() == (0 if name == "SIGHUP" else 128 + number)
    assert made.output.count(f"{name}: stopping the wheels") == 1
    assert "Traceback" not in made.output


@pytest.mark.nightly
def test_a_signal_that_arrives_twice_is_logged_once(
    started: Callable[..., tuple[MakeRun, str]], client: Callable[..., Client]
) -> None:
    """As from `make`, which passes on what its whole group has had."""
    made, endpoint = started()
    client("client", endpoint).in_state("standing")
    for _ in range(3):
        made.process.terminate()
    assert made.end() == 0
    assert made.output.count("SIGTERM: stopping the wheels") == 1


@pytest.mark.nightly
def test_a_port_that_is_named_is_taken_and_nothing_simulated(
    started: Callable[..., tuple[MakeRun, str]], client: Callable[..., Client]
) -> None:
    made, endpoint = started("--port", "/dev/not-there")
    app = client("client", endpoint)
    wait_for(lambda: "/dev/not-there" in app.latest("status")["why"], "the port in the reason")
    assert app.latest("status")["state"] == "waiting"
    assert "simulated" not in made.output
    assert made.end() == 0


def test_a_mistake_in_the_options_ends_it_with_the_daemons_status(
    started: Callable[..., tuple[MakeRun, str]],
) -> None:
    made, _ = started("--set", "chassis.wheel_separation_m=-1")
    assert made.process.wait(60) == 78
    assert made.end() == 78
    assert "chassis.wheel_separation_m" in made.output
    assert "second terminal" not in made.output
    assert "Traceback" not in made.output


@pytest.mark.nightly
def test_where_the_daemon_does_not_start_no_one_is_invited_to_drive_it() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        listen = f"zenoh.listen=tcp/127.0.0.1:{taken.getsockname()[1]}"
        made = MakeRun("--set", listen, "--set", "zenoh.connect=[]", "--listen", "127.0.0.1:0")
        assert made.process.wait(60) == 69
        assert made.end() == 69
    assert "cannot listen" in made.output
    assert "second terminal" not in made.output


def test_a_slow_start_is_waited_for_with_a_line_every_few_seconds(
    capsys: pytest.CaptureFixture[str],
) -> None:
    spec = importlib.util.spec_from_file_location("make_run", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    make_run = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make_run)
    starts = make_run.Starting("yahboomd", 100.0)
    for tenths in range(1000, 1121):
        starts.wait_on(tenths / 10)
    assert capsys.readouterr().out.splitlines() == [
        "yahboomd starts, for 5 s so far; Ctrl-C ends it.",
        "yahboomd starts, for 10 s so far; Ctrl-C ends it.",
    ]
