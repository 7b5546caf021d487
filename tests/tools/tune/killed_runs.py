"""`tune` killed at random moments, and what --undo makes of the board: by `make tuning-kills`."""

from __future__ import annotations

import json
import os
import socket
import time
from pathlib import Path
from random import Random

import pytest
from real_robot import Process, wait_for
from simulated_board import SimulatedBoard, simulated_board  # noqa: F401

FLASH = {"dead_zone": 1500, "p": 0.3, "i": 0.6, "d": 0.0}
LONGEST_S = 30.0
"""About as long as a tuning takes."""

WRITES_WITHIN_S = 1.2
MOMENTS = ("at any moment", "after a write began", "with the supply lost within a write")


def shown(board: SimulatedBoard) -> dict[str, float]:
    """The board's stored values, as another command reads them."""
    probing = Process("probe", "--json", "--port", board.port)
    probing.end_by_itself()
    report = json.loads(probing.output[probing.output.index("{") :])
    assert "settings" in report, probing.output
    return {row["name"]: row["have"] for row in report["settings"]}


@pytest.mark.parametrize("seed", range(int(os.environ.get("RUNS", "3"))))
def test_killed_at_any_moment_the_wheels_stand_and_undo_restores_the_board(
    simulated_board,  # noqa: F811
    tmp_path: Path,
    seed: int,
) -> None:
    random, moment = Random(seed), MOMENTS[seed % len(MOMENTS)]
    control = tmp_path / "control"
    flash = [word for name, value in FLASH.items() for word in ("--flash", f"{name}={value}")]
    board = simulated_board(*flash, "--control", str(control), "--seed", str(seed))
    before = shown(board)
    words = ("tune", "--port", board.port, "--output", str(tmp_path / "steps.svg"))
    tuning = Process(*words, "--yes", environ={"STATE_DIRECTORY": str(tmp_path)})
    if moment == MOMENTS[0]:
        after_s = random.uniform(0.0, LONGEST_S)
    else:
        if moment == MOMENTS[2]:
            with socket.socket(socket.AF_UNIX) as console:
                console.connect(str(control))
                console.sendall(b"cut-writes\n")
                assert console.recv(99) == b"ok\n"
        tuning.says("writing to the board's flash")
        after_s = random.uniform(0.0, WRITES_WITHIN_S)
    time.sleep(after_s)
    tuning.process.kill()
    ended = tuning.end_by_itself()
    began = time.monotonic()
    wait_for(lambda: board.stands, "the wheels stand")
    stood_s = time.monotonic() - began
    saved = list(tmp_path.glob("before-tune*.json"))
    left = shown(board)
    undoing = Process(*words, "--undo", environ={"STATE_DIRECTORY": str(tmp_path)})
    status = undoing.end_by_itself()
    assert "Traceback" not in undoing.output + tuning.output
    assert shown(board) == before
    assert status == (0 if saved else 1), undoing.output
    print(
        f"{moment}, {after_s:.2f} s: {'killed' if ended < 0 else 'had ended'}, stood within "
        f"{stood_s:.2f} s, {'changed' if left != before else 'unchanged'}"
        f"{', lost' if any(value is None or value < 0 for value in flat(left)) else ''}, "
        f"{'restored' if saved else 'nothing saved'}"
    )


def flat(values: dict[str, object]) -> list[float | None]:
    """All numbers of the settings."""
    return [
        number
        for value in values.values()
        for number in (value if isinstance(value, list) else [value])
    ]
