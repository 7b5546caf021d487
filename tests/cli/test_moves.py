"""``yahboomd moves``: serves, reports the daemon, ends in order."""

from __future__ import annotations

import pytest
from real_robot import Process

pytestmark = pytest.mark.realtime


@pytest.mark.xdist_group("one_robot")
def test_it_serves_a_second_one_says_only_that_and_a_signal_ends_it(one_robot) -> None:
    served = Process("moves", "--connect", one_robot.endpoint)
    served.says(f"Moves are served at {one_robot.endpoint}.")
    second = Process("moves", "--connect", one_robot.endpoint)
    assert second.end_by_itself() == 1
    assert "serves this robot already" in second.output
    assert "Moves are served" not in second.output
    assert served.end() == 0
    assert f"yahboomd at {one_robot.endpoint} answers." in served.output
