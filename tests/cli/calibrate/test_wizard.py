"""A run counts from where the person let it begin."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest
from led_calibration import LedCalibration
from real_robot import Client, RealRobot, wait_for

pytestmark = pytest.mark.realtime


def test_the_way_onto_its_mark_is_no_part_of_a_run(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client], tmp_path: Path
) -> None:
    robot = real_robot()
    robot.daemon.says("Connected to")
    led = LedCalibration(robot.endpoint, tmp_path, "tape", "--straight", "0.5", "--speed", "0.4")
    try:
        asked = led.question()
        person = client("client", robot.endpoint)
        begin = robot.settled_truth()
        rested_ns = begin.t_ns + 1_500_000_000
        wait_for(lambda: robot.truth()[-1].t_ns > rested_ns, "it has stood for a while")
        person.drive_until(b'{"vx": 0.4}', lambda: robot.truth()[-1].x > begin.x + 0.3, "pushed")
        mark = robot.settled_truth()
        led.answer(asked)
        assert led.question()["name"] == "length"
        end = robot.settled_truth()
        assert math.hypot(end.x - mark.x, end.y - mark.y) == pytest.approx(0.5, abs=0.1)
    finally:
        led.close()
