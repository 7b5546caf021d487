"""Daemons killed right after they acknowledged an emergency stop: `make estop-kills`."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from estop_kills import KillableRobot

from yahboomd.core.protocol.registry import DIALECTS

RUNS = int(os.environ.get("RUNS", "30"))
SEED = int(os.environ.get("SEED", "1"))


@pytest.mark.parametrize("dialect", DIALECTS)
def test_no_stop_is_acknowledged_that_the_board_does_not_get(tmp_path: Path, dialect: str) -> None:
    robot = KillableRobot(tmp_path, dialect, SEED)
    runs = RUNS // len(DIALECTS) + (RUNS % len(DIALECTS) > list(DIALECTS).index(dialect))
    try:
        found = [robot.kill_one() for _ in range(runs)]
    finally:
        robot.close()
    print(f"{dialect}: {len(found)} kills, {dict(robot.found)}")
    wrong = [each for each in found if each is not None]
    assert not wrong, f"{len(wrong)} of {len(found)}: {wrong}"
