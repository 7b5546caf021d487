"""The emergency stop outlives the process that received it."""

from __future__ import annotations

from pathlib import Path

import pytest
from estop_kills import KillableRobot

pytestmark = pytest.mark.realtime


@pytest.mark.parametrize(
    "dialect",
    [
        "streamed",
        *(pytest.param(name, marks=pytest.mark.nightly) for name in ("polled", "rosmaster")),
    ],
)
def test_a_daemon_that_is_killed_after_its_acknowledgement_has_stopped_the_robot(
    tmp_path: Path, dialect: str
) -> None:
    # At length: `make estop-kills`.
    robot = KillableRobot(tmp_path, dialect, seed=3)
    try:
        assert [robot.kill_one() for _ in range(4)] == [None] * 4
    finally:
        robot.close()
