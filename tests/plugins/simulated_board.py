"""A simulated board alone, a real process on a real pty. Import the fixture to have it."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from left_guards import end_guards
from process_priority import BOARD_NICE, prefer
from real_robot import Process, wait_for

from yahboomd.simulation.truth import TruthSample, read_truth

_DRIVER = """
import itertools, os, select, sys
from yahboomd.core.link.seize import seize
port = seize(sys.argv[1])
print("driving", flush=True)
# Again and again: on a busy machine two frames may come as one, and the second is lost.
frames = (b"$mtype:1#", b"$speed:300,0,300,0#", b"$spd:300,0,300,0#", b"$upload:1,0,0#")
for frame in itertools.cycle(frames):
    os.write(port.fd, frame)
    if select.select([sys.stdin], [], [], 0.05)[0]:
        break
"""


class SimulatedBoard:
    """`yahboomd simulate` in a process of its own.

    Args:
        folder: For the port's name and the truth.
        options: More arguments of `yahboomd simulate`.
    """

    def __init__(self, folder: Path, *options: str) -> None:
        self.port = str(folder / "board")
        self.truth_path = folder / "truth"
        self.process = Process(
            "simulate", "--link", self.port, "--truth", str(self.truth_path), *options
        )
        prefer(self.process.process, BOARD_NICE)
        self.process.says("is at")
        self.owner: subprocess.Popen[str] | None = None

    def drive(self) -> None:
        """Have a process of its own hold the port and turn the wheels, until it is killed."""
        self.owner = subprocess.Popen(
            [sys.executable, "-c", _DRIVER, self.port],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.owner.stdout is not None
        assert self.owner.stdout.readline() == "driving\n"
        wait_for(lambda: min(self.speeds) > 0.2, "the wheels turn")

    def kill_owner(self) -> None:
        """Kill the driving process by SIGKILL."""
        owner, self.owner = self.owner, None
        if owner is not None:
            owner.kill()
            owner.communicate()

    @property
    def speeds(self) -> tuple[float, ...]:
        """The true speeds of the driven wheels, not before they are asked for."""
        asked_ns = time.monotonic_ns()

        def samples() -> list[TruthSample]:
            # The file is written with a delay; its stamps are this machine's monotonic clock.
            return [each for each in read_truth(self.truth_path) if each.t_ns >= asked_ns]

        return tuple(wait_for(samples, "the truth")[0].speed_m_s)

    @property
    def stands(self) -> bool:
        """Whether they truly stand."""
        return max(map(abs, self.speeds)) < 0.03

    def close(self) -> None:
        """End everything."""
        self.kill_owner()
        self.process.end()


@pytest.fixture
def simulated_board(tmp_path: Path) -> Iterator[Callable[..., SimulatedBoard]]:
    """Starts boards: ``simulated_board("--dialect", "polled")``."""
    boards: list[SimulatedBoard] = []

    def start(*options: str) -> SimulatedBoard:
        folder = tmp_path / f"board{len(boards)}"
        folder.mkdir()
        boards.append(SimulatedBoard(folder, *options))
        return boards[-1]

    yield start
    end_guards()
    for board in boards:
        board.close()
