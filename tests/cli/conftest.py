from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from fake_daemon import fake_daemon
from real_robot import Process, wait_for
from terminal_process import terminal

from yahboomd.cli.main import main
from yahboomd.simulation.truth import read_truth

__all__ = ["fake_daemon", "terminal", "yahboomd"]


@pytest.fixture
def yahboomd(tmp_path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run the command in a process of its own, with no configuration of this machine's."""

    def run(*arguments: str, **environ: str) -> subprocess.CompletedProcess[str]:
        clean = {key: value for key, value in os.environ.items() if "YAHBOOMD_" not in key}
        return subprocess.run(
            [sys.executable, "-W", "error", "-m", "yahboomd", *arguments],
            env=clean | environ,
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )

    return run


class SimulatedBoard:
    """`yahboomd simulate` in a process of its own, on a real pty."""

    def __init__(self, folder: Path, *options: str) -> None:
        self.port = str(folder / "board")
        self.truth_path = folder / "truth"
        self.process = Process(
            "simulate", "--link", self.port, "--truth", str(self.truth_path), *options
        )
        self.process.says("is at")

    @property
    def speeds(self) -> tuple[float, ...]:
        """The true speeds of the wheels, a moment ago."""
        samples = wait_for(lambda: read_truth(self.truth_path), "the truth")
        return samples[-1].speed_m_s

    def stands(self) -> bool:
        return max(map(abs, self.speeds)) < 0.03


@pytest.fixture
def simulated_board(tmp_path) -> Iterator[Callable[..., SimulatedBoard]]:
    """Starts boards: ``simulated_board("--dialect", "polled")``."""
    boards: list[SimulatedBoard] = []

    def start(*options: str) -> SimulatedBoard:
        folder = tmp_path / f"board{len(boards)}"
        folder.mkdir()
        boards.append(SimulatedBoard(folder, *options))
        return boards[-1]

    yield start
    for board in boards:
        board.process.end()


@pytest.fixture
def say() -> Callable[..., int]:
    """Run a command in this process: ``say("probe", "--list")`` returns its exit status."""

    def run(*arguments: str) -> int:
        return main(list(arguments))

    return run
