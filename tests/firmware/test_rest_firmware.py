"""Wheels at rest on the vendor's firmware: no output, no jerk afterwards, and no roll down a slope.

The motors are those of the plant: a released wheel rolls where the slope overcomes 0.3 m/s^2 of
friction.
"""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from robot_bench import RobotBench
from vendor_firmware import KINDS, MOTORS, ON_THE_FIRMWARE, STICKING, kinds, of_all

from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time

pytestmark = ON_THE_FIRMWARE

ROLLED_MM = {0.05: 15.0, 0.1: 25.0, 0.2: 60.0}
"""The farthest of the quick motors."""
SLOW_MM = {0.05: 65.0, 0.1: 125.0, 0.2: 240.0}
"""Motors that lag by 0.2 s or more: with its stored gains the board's loop needs long."""

LEAP_M_S = 0.2
"""A wheel that sticks leaps as it breaks away, from the commanded 0.1 m/s."""

CASES = of_all(((motor, slope) for motor in MOTORS for slope in ROLLED_MM), every=10)


def outputs(bench: RobotBench) -> list[int]:
    return [motor.pwm for motor in bench.robot.plant.motors]


def travel_m(bench: RobotBench) -> list[float]:
    return [motor.travel_m for motor in bench.robot.plant.motors]


async def driven(folder: Path, motor: str) -> RobotBench:
    bench = RobotBench(folder, (), SimulationOptions(**KINDS[motor]))
    await bench.__aenter__()
    await bench.ready()
    await bench.drive(1.5, 0.3)
    bench.command(0.0)
    return bench


@pytest.mark.parametrize("motor", kinds(3, 1))
@on_virtual_time
async def test_at_rest_no_motor_has_output_and_the_next_motion_begins_without_a_jerk(
    tmp_path: Path, motor: str
) -> None:
    bench = await driven(tmp_path, motor)
    await asyncio.sleep(4.0)
    before_m = travel_m(bench)
    for _ in range(50):
        await asyncio.sleep(0.01)
        assert outputs(bench) == [0, 0]
    assert travel_m(bench) == before_m
    fastest = 0.0
    for _ in range(30):
        bench.command(0.1)
        for _ in range(20):
            await asyncio.sleep(0.0025)
            speeds = [each.speed_m_s for each in bench.robot.plant.motors]
            fastest = max(fastest, *speeds)
    assert max(speeds) > 0.07
    assert fastest < (LEAP_M_S if motor in STICKING else 0.15)
    assert not {"no_counts", "rolled", "stop_not_obeyed"} & {*bench.heard.kinds}
    await bench.__aexit__()


@pytest.mark.parametrize(("motor", "slope"), CASES)
@on_virtual_time
async def test_on_a_slope_a_released_wheel_is_held_within_100_ms_of_5_mm(
    tmp_path: Path, motor: str, slope: float
) -> None:
    bench = await driven(tmp_path, motor)
    await asyncio.sleep(4.0)
    assert outputs(bench) == [0, 0]
    start_m = max(travel_m(bench))
    bench.robot.plant.stand_on(slope)
    rolled_ms, held_ms = [], []
    for ms in range(3000):
        await asyncio.sleep(0.001)
        if max(travel_m(bench)) - start_m > 0.005:
            rolled_ms.append(ms)
        if any(outputs(bench)):
            held_ms.append(ms)
    way_mm = (max(travel_m(bench)) - start_m) * 1e3
    print(f"{motor}, {slope:.0%}: held after {held_ms[0] - rolled_ms[0]} ms, {way_mm:.1f} mm")
    assert held_ms[0] - rolled_ms[0] <= 100
    assert bench.heard.kinds.count("rolled") == 1
    lags = KINDS[motor]["time_constant_s"] >= 0.2
    assert way_mm < (SLOW_MM if lags else ROLLED_MM)[slope]
    assert bench.controller.state()[0] == "standing"
    await bench.__aexit__()


@pytest.mark.parametrize("motor", of_all(["44 %, slow", "44 %, lazy"], every=2, first=1))
@on_virtual_time
async def test_wheels_that_were_cut_for_a_slow_stop_are_held_on_a_slope(
    tmp_path: Path, motor: str
) -> None:
    bench = await driven(tmp_path, motor)
    await asyncio.sleep(0.6)
    bench.robot.plant.stand_on(0.1)
    start_m = max(travel_m(bench))
    await asyncio.sleep(5.0)
    assert bench.controller.counters["slow_stops"] == 1
    assert bench.heard.kinds == ["connected", "rolled"]
    assert max(travel_m(bench)) - start_m < 0.15
    assert bench.controller.state()[0] == "standing"
    await bench.__aexit__()
