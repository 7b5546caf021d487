"""The daemon on the vendor's Rosmaster firmware 3.5.1: cars drive, stop, and name their alarm."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Iterator
from pathlib import Path

import pytest
from fault_bench import FaultBench
from robot_bench import state_and_why
from rosmaster_firmware import firmware_instead_of_simulated
from vendor_firmware import rosmaster_missing

from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.rosmaster.rosmaster_flash import RosmasterStored
from yahboomd.simulation.virtual_time import on_virtual_time

pytestmark = [
    pytest.mark.skipif(bool(rosmaster_missing()), reason=rosmaster_missing()),
    pytest.mark.usefixtures("vendors_rosmaster"),
]

CARS = {
    "x3": ("mecanum", 1),
    "x3-plus": ("mecanum", 2),
    "x1": ("4wd", 4),
    "r2": ("ackermann", 5),
    "sunrise": ("mecanum", 6),
}
DRIVES = {"mecanum": "mecanum", "4wd": "skid_steer", "ackermann": "ackermann"}
TWO_CELLS_V, THREE_CELLS_V = 7.6, 11.4


@pytest.fixture
def vendors_rosmaster() -> Iterator[None]:
    with firmware_instead_of_simulated():
        yield


def car(tmp_path: Path, name: str, *more: str) -> FaultBench:
    preset, car_type = CARS[name]
    profile = PROFILES[name]
    volts = TWO_CELLS_V if name == "sunrise" else THREE_CELLS_V
    overrides = [
        *more,
        *(f"board.profile={name}", f"chassis.preset={preset}"),
        "chassis.wheel_separation_m=0.1911",
    ]
    if preset != "4wd":
        overrides.append("chassis.wheel_base_m=0.23537")
    return FaultBench(
        tmp_path,
        tuple(overrides),
        SimulationOptions(
            dialect="rosmaster",
            drive=DRIVES[preset],  # type: ignore[arg-type]
            flash=RosmasterStored(car_type=car_type),
            lines=profile.lines,
            ratio=profile.ratio,
            wheel_radius_m=profile.wheel_radius_m,
            wheel_separation_m=0.1911,
            wheel_base_m=0.23537,
            motor_dead_zone=1500,
            battery_volts=volts,
            rated_volts=volts,
            start_up_s=0.5,
        ),
    )


@pytest.mark.parametrize("name", CARS)
@on_virtual_time
async def test_each_car_drives_its_curve_on_its_firmware_and_stands(
    tmp_path: Path, name: str
) -> None:
    async with car(tmp_path, name) as bench:
        await bench.ready()
        for vx, wz in ((0.3, 0.4), (-0.3, 0.4)):
            await bench.drive(2.5, vx, wz)
            truth = bench.robot.truth(bench.clock.now_ns())
            assert truth.vx == pytest.approx(vx, abs=0.05)
            assert truth.wz == pytest.approx(wz, abs=0.12)
        await bench.drive(2.0, 0.0)
        assert bench.standing
        truth = bench.robot.truth(bench.clock.now_ns())
        pose = bench.heard.estimates[-1].pose
        assert math.hypot(pose.x - truth.x, pose.y - truth.y) < 0.06
        assert bench.events("motor_fault") == []


@pytest.mark.parametrize(
    ("name", "volts", "words"),
    [
        ("x3", 9.25, "Below 9.6 V or above 13.0 V for 2 s, it brakes"),
        ("sunrise", 8.85, "Below 6.5 V or above 8.5 V for 2 s, it brakes"),
    ],
)
@on_virtual_time
async def test_a_latched_alarm_is_named_with_the_cars_limits_and_a_reset_ends_it(
    tmp_path: Path, name: str, volts: float, words: str
) -> None:
    async with car(tmp_path, name) as bench:
        await bench.ready()
        good = bench.robot.plant.battery_volts
        bench.robot.plant.battery_volts = volts
        await bench.drive(8.0, 0.0)
        bench.robot.plant.battery_volts = good
        await bench.drive(4.0, 0.3)
        assert bench.standing
        state, why = state_and_why(bench.controller)
        assert state == "waiting"
        # As the alarm had it, whatever the battery has now.
        assert f"Its supply had {volts - 0.05:.1f} V at the alarm. {words}" in why
        bench.do("reset")
        await bench.drive(8.0, 0.3)
        assert min(bench.rim_speeds) > 0.2


@on_virtual_time
async def test_after_a_reset_no_supply_of_zero_volts_is_reported(tmp_path: Path) -> None:
    async with car(tmp_path, "x3", "board.battery_period_s=0.1") as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        for _ in range(5):
            bench.do("reset")
            await asyncio.sleep(6.0)
        assert len(bench.heard.volts) > 50
        assert min(bench.heard.volts) > 10.0
