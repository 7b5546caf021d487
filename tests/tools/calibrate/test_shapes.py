"""Ticks of single motors as the travel of two sides, and how long a leg may last."""

from __future__ import annotations

import asyncio
import math
from pathlib import Path

import pytest
from bench_client import BenchClient
from robot_bench import RobotBench

from yahboomd.core.config import read
from yahboomd.core.drive.kinematics import wheel_speeds
from yahboomd.core.model import Twist2d
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.calibrate.shapes import Leg, LegDriver, Sides, sideways


def config(preset: str):
    overrides = [f"chassis.preset={preset}"]
    if preset == "mecanum":
        overrides.append("chassis.wheel_base_m=0.2")
    return read(None, environ={}, overrides=overrides).config


@pytest.mark.parametrize("preset", ["2wd", "4wd", "mecanum"])
def test_a_side_is_the_mean_of_its_motors_without_any_calibration(preset: str) -> None:
    made = config(preset)
    multipliers = {made.kinematics().wheels[0]: 1.2}
    chassis = made.chassis.model_copy(update={"wheel_radius_multiplier": multipliers})
    calibrated = made.model_copy(update={"chassis": chassis})
    motors = calibrated.motors()
    wheels = calibrated.kinematics().wheels
    per_turn = made.ticks_per_revolution()
    moved = [per_turn if wheels[motor.wheel].endswith("left") else 0.0 for motor in motors]
    sides = Sides(calibrated, [motor.name for motor in motors])
    left, right = sides.travel([[0.0] * len(motors), moved])
    assert left[0] == pytest.approx(2.0 * math.pi * made.radius_m(wheels[0]))
    assert right[0] == 0.0


def test_a_wheel_that_the_board_holds_stands_though_its_counts_hunt() -> None:
    made = config("2wd")
    sides = Sides(made, [motor.name for motor in made.motors()])
    # Eight counts were the most on the vendor's firmware; a wheel that rolls on passes 2 mm.
    assert not sides.moved((1000, 1000), (1008, 992))
    assert sides.moved((1000, 1000), (1000, 1014))
    assert sides.moved((1000, 1000), (986, 1000))


def test_a_leg_is_done_by_the_counts_and_lasts_no_longer_than_it_says() -> None:
    back = Leg(-0.2, 0.0, 1.0)
    assert back.done(-0.5, -0.5, 0.2) == 0.5
    assert back.limit_s == pytest.approx(12.5)
    right = Leg(0.0, -1.0, math.pi)
    assert right.done(0.1, -0.1, 0.2) == pytest.approx(1.0)


def test_a_mecanum_base_counts_its_way_to_the_side_and_turns_by_wheels_and_axles() -> None:
    made = config("mecanum")
    motors, kinematics = made.motors(), made.kinematics()
    sides = Sides(made, [motor.name for motor in motors])
    assert sides.separation_m == pytest.approx(0.15 + 0.2)
    wish = Twist2d(vx=0.1, vy=0.3, wz=0.5)
    per_m = motors[0].ticks_per_revolution / (2.0 * math.pi * motors[0].radius_m)
    ticks = [0.0] * 4, [speed * per_m for speed in wheel_speeds(kinematics, wish)]
    left, right = sides.travel(ticks)
    assert (left[0] + right[0]) / 2.0 == pytest.approx(0.1)
    assert (right[0] - left[0]) / sides.separation_m == pytest.approx(0.5)
    assert sides.to_the_left(ticks)[0] == pytest.approx(0.3)
    (leg,) = sideways(-1.0, 0.2)
    assert (leg.vx, leg.vy, leg.wz, leg.amount) == (0.0, -0.2, 0.0, 1.0)
    assert leg.done(0.0, 0.0, 1.0, to_the_left_m=-0.4) == 0.4
    assert leg.limit_s == pytest.approx(12.5)


async def _asked() -> None:
    await asyncio.sleep(4.0)


@on_virtual_time
async def test_an_open_question_keeps_no_counts(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        driver = LegDriver(BenchClient(bench), bench.config, "cmd_vel", clock=bench.clock)  # type: ignore[arg-type]
        await driver.begin(_asked())
        assert len(driver.gathered()[0]) == 0
