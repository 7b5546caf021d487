"""`make run`: a daemon on a simulated board, or on a real port."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from real_robot import Client, free_endpoint, wait_for

pytestmark = pytest.mark.realtime

SCRIPT = Path(__file__).resolve().parents[2] / "tools" / "run.py"


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

    def start(*arguments: str) -> tuple[MakeRun, str]:
        endpoint = free_endpoint()
        settings = (f'zenoh.listen=["{endpoint}"]', "zenoh.connect=[]")
        latch = f"estop.latch_file={tmp_path / 'estop'}"
        sets = [word for each in (*settings, latch) for word in ("--set", each)]
        running.append(MakeRun(*arguments, *sets))
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
    app.drive(b'{"vx": 0.3}', 0.5)
    wait_for(lambda: app.latest("pose")["x"] > 0.05, "it moved")
    assert ".venv/bin/yahboomd drive" in made.output
    assert made.end() == 0
    assert "Traceback" not in made.output


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
    assert "chassis.wheel_separation_m" in made.output
    assert "Traceback" not in made.output
