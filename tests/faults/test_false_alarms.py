"""Healthy motors are never taken for lying ones: a robot that stops for nothing is of no use.

Virtual time; motors of several kinds, all geometries, driven wildly.
"""

from __future__ import annotations

import asyncio
import itertools
import json
import random
import re
from pathlib import Path
from typing import get_args

import pytest
from fault_bench import DIALECTS, FaultBench

from yahboomd.core.drive.faults import FaultKind
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time

CORNERS = ",".join(
    f"{name}=[{{position={position}}}]"
    for position, name in enumerate(("front_left", "rear_left", "front_right", "rear_right"), 1)
)
BASES: dict[str, list[str]] = {
    "differential": [],
    "skid_steer": [
        "chassis.kinematics=skid_steer",
        "chassis.motors={left=[{position=1},{position=2}],right=[{position=3},{position=4}]}",
    ],
    "mecanum": [
        "chassis.kinematics=mecanum",
        "chassis.wheel_base_m=0.15",
        f"chassis.motors={{{CORNERS}}}",
    ],
}
UNLIMITED = [
    "limits.linear={velocity=1.9, acceleration=1e6, deceleration=1e6}",
    "limits.angular={velocity=1e6, acceleration=1e6, deceleration=1e6}",
]
QUICK, USUAL, SLUGGISH = (0.03, 1750), (0.06, 1950), (0.1, 2050)
SPEEDS = [0.0, 0.02, 0.05, 0.08, 0.1, 0.2, 0.4, 0.7, 1.0, 1.5]
TURNS = [0.0, 0.0, 0.3, 1.0, 3.0, 6.0, 12.0]
ORDINARY = {"connected"}
SATURATED = {"gyro_unfit", "gyro_fit"}
"""A board with a gyro, which the wildest turns exceed: that is true, and stops nothing."""


def base(
    tmp_path: Path, drive: str, dialect: str, motor: tuple[float, int], seed: int, limits: list[str]
) -> FaultBench:
    time_constant_s, dead_zone = motor
    simulation = SimulationOptions(
        dialect=dialect,  # type: ignore[arg-type]
        drive=drive,  # type: ignore[arg-type]
        time_constant_s=time_constant_s,
        motor_dead_zone=dead_zone,
        seed=seed,
    )
    return FaultBench(tmp_path, [*BASES[drive], *limits], simulation)


@pytest.mark.cases(1)
@pytest.mark.parametrize("limits", [[], UNLIMITED], ids=["limited", "unlimited"])
@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("drive", BASES)
@on_virtual_time
async def test_wild_driving_with_healthy_motors_raises_no_alarm(
    tmp_path: Path, drive: str, dialect: str, limits: list[str]
) -> None:
    chance = random.Random(f"{drive} {dialect} {limits}")
    motor = chance.choice([QUICK, USUAL, SLUGGISH])
    async with base(tmp_path, drive, dialect, motor, chance.randrange(99), limits) as bench:
        await bench.ready()
        for _ in range(12):
            wish = {
                "vx": chance.choice(SPEEDS) * chance.choice([1, -1]),
                "vy": chance.choice([0.0, 0.2, 0.6]) if drive == "mecanum" else 0.0,
                "wz": chance.choice(TURNS) * chance.choice([1, -1]),
            }
            for _ in range(chance.choice([1, 2, 3, 6, 12, 24, 40])):
                bench.payload(json.dumps(wish).encode())
                await asyncio.sleep(0.05)
            match chance.randrange(8):
                case 0:
                    bench.command(0.0)
                    await asyncio.sleep(chance.choice([0.02, 0.1, 0.5]))
                case 1:
                    bench.controller.bus_lost()
                    await asyncio.sleep(0.2)
                case 2:
                    await asyncio.sleep(chance.choice([0.6, 1.5]))
        await asyncio.sleep(1.5)
        # A floor may hold a slow wheel.
        held_at = [
            float(speed)
            for words in bench.events("not_started")
            for speed in re.findall(r"at (\S+) m/s", words)
        ]
        assert max(held_at, default=0.0) <= 0.08
        assert set(bench.heard.kinds) - SATURATED - {"not_started"} == ORDINARY
        assert bench.standing


@pytest.mark.nightly
@pytest.mark.cases(1)
@pytest.mark.parametrize("limits", [[], UNLIMITED], ids=["limited", "unlimited"])
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_every_speed_from_a_crawl_to_full_and_back_raises_no_alarm(
    tmp_path: Path, dialect: str, limits: list[str]
) -> None:
    async with base(tmp_path, "differential", dialect, USUAL, 0, limits) as bench:
        await bench.ready()
        for millimetres in (5, 15, 30, 50, 80, 100, 300, 600, 1100):
            # There, at once back, and to rest.
            await bench.drive(0.7, millimetres / 1000)
            await bench.drive(0.7, -millimetres / 1000)
            await bench.drive(0.3)
        await asyncio.sleep(1.5)
        assert set(bench.heard.kinds) == ORDINARY


@on_virtual_time
async def test_a_robot_that_was_let_go_may_be_pushed_about(tmp_path: Path) -> None:
    async with base(
        tmp_path, "differential", "streamed", USUAL, 0, ["command.at_rest=release"]
    ) as bench:
        await bench.ready()
        await bench.drive(0.5, 0.3)
        await asyncio.sleep(2.0)
        bench.do("turning all 0.5")
        await asyncio.sleep(2.0)
        bench.do("repair all")
        await asyncio.sleep(1.0)
        assert set(bench.heard.kinds) == ORDINARY
        await bench.drive(1.0, 0.3)
        assert min(bench.rim_speeds) > 0.2


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_a_start_that_the_port_holds_back_accuses_no_wheel(
    tmp_path: Path, dialect: str
) -> None:
    async with base(tmp_path, "differential", dialect, USUAL, 0, UNLIMITED) as bench:
        await bench.ready()
        await asyncio.sleep(0.5)
        assert bench.port is not None
        # The kernel takes nothing for a while, which is too short for it to be stuck.
        bench.port.pending = 1
        await bench.drive(0.25, 0.3)
        bench.port.pending = 0
        await bench.drive(1.0, 0.3)
        assert set(bench.heard.kinds) == ORDINARY
        assert min(bench.rim_speeds) > 0.25


@pytest.mark.nightly
@pytest.mark.cases(1)
@pytest.mark.parametrize(
    ("dialect", "loss"),
    [*itertools.product(DIALECTS, (0.02, 0.05)), ("streamed", 0.08)],
)
@on_virtual_time
async def test_a_line_that_loses_bytes_is_blamed_for_what_healthy_wheels_make_of_them(
    tmp_path: Path, dialect: str, loss: float
) -> None:
    async with base(tmp_path, "differential", dialect, USUAL, 3, UNLIMITED) as bench:
        await bench.ready()
        bench.robot.impairments.change(loss=loss)
        for _ in range(24):
            await bench.drive(0.6, 0.4)
            await bench.drive(0.6, -0.4)
            await asyncio.sleep(0.8)
        # Of 48 starts one or two are taken for a floor that holds the wheels.
        faults = set(get_args(FaultKind)) - ({"not_started"} if loss >= 0.05 else set())
        assert not set(bench.heard.kinds) & faults
        assert bench.controller.state()[0] != "fault"
        # The line is blamed, and it drives again without a person.
        assert bench.controller.counters["noisy_cuts"] == len(bench.events("line_noisy"))
        # A streamed line that loses much shows it by its counts.
        assert loss < 0.08 or bench.events("line_noisy")
