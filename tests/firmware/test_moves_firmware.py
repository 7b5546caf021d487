"""Moves on the vendors' firmwares, on virtual time."""

from __future__ import annotations

import asyncio
import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from move_bench import Drive, MoveBench
from rosmaster_firmware import firmware_instead_of_simulated
from vendor_firmware import MOTORS, ON_THE_FIRMWARE, rosmaster_missing

from yahboomd.client.move_messages import Move
from yahboomd.simulation.virtual_time import on_virtual_time

LONG = bool(os.environ.get("YAHBOOMD_FIRMWARE_LONG"))
FIT = [name for name, motor in MOTORS.items() if motor["motor_dead_zone"] < 1650]
"""Motors that turn at what the firmware is set to; others need more at low speeds than it gives."""

UNFIT = [name for name in MOTORS if name not in FIT]
ROSMASTER = pytest.mark.skipif(bool(rosmaster_missing()), reason=rosmaster_missing())


@pytest.fixture
def vendors_rosmaster() -> Iterator[None]:
    with firmware_instead_of_simulated():
        yield


async def reached(bench: MoveBench, move: Move) -> Drive:
    driven = await bench.move([move])
    assert driven.ended.reason == "reached", driven.ended
    return driven


def four_channel(tmp_path: Path, motor: str) -> MoveBench:
    simulation: dict[str, Any] = {"rated_volts": 7.4, "battery_volts": 7.4, **MOTORS[motor]}
    lag_s = simulation.pop("time_constant_s")
    return MoveBench(tmp_path, "2wd", lag_s, **simulation)


@pytest.mark.parametrize("motor", FIT if LONG else FIT[:1])
@ON_THE_FIRMWARE[0]
@ON_THE_FIRMWARE[1]
@on_virtual_time
async def test_moves_end_where_they_should(tmp_path: Path, motor: str) -> None:
    async with four_channel(tmp_path, motor) as bench:
        await bench.ready()
        await asyncio.sleep(0.3)
        straight = await reached(bench, Move(kind="straight", distance_m=0.4))
        assert straight.ahead_m == pytest.approx(0.4, abs=0.002)
        # A bench that takes bytes from the line makes another one of it.
        assert bench.supervisor.session is not None
        assert not bench.supervisor.session.status_values().get("unrecognised")
        if LONG:
            turn = await reached(bench, Move(kind="turn", angle_rad=1.0))
            assert turn.turned_rad == pytest.approx(1.0, abs=math.radians(0.5))
            home = await reached(bench, Move(kind="go_to", x=0.0, y=0.0, backward=True))
            assert math.hypot(home.end.x, home.end.y) < 0.005


@pytest.mark.skipif(not LONG, reason="a minute: YAHBOOMD_FIRMWARE_LONG")
@pytest.mark.parametrize("motor", UNFIT)
@ON_THE_FIRMWARE[0]
@ON_THE_FIRMWARE[1]
@on_virtual_time
async def test_motors_that_need_more_than_the_board_adds_end_there_or_say_why_not(
    tmp_path: Path, motor: str
) -> None:
    async with four_channel(tmp_path, motor) as bench:
        await bench.ready()
        await asyncio.sleep(0.3)
        straight = await reached(bench, Move(kind="straight", distance_m=0.4))
        assert straight.ahead_m == pytest.approx(0.4, abs=0.002)
        turn = await bench.move([Move(kind="turn", angle_rad=1.0)])
        is_there = abs(turn.turned_rad - 1.0) < math.radians(0.7)
        assert (turn.ended.reason == "reached") is is_there
        assert turn.ended.reason in {"reached", "blocked", "short"}
        await asyncio.sleep(0.5)
        assert bench.standing


@pytest.mark.usefixtures("vendors_rosmaster")
@pytest.mark.parametrize("car", ["x3", "x1"] if LONG else ["x3"])
@ROSMASTER
@on_virtual_time
async def test_moves_end_where_they_should_on_a_rosmaster(tmp_path: Path, car: str) -> None:
    async with MoveBench(tmp_path, car, motor_dead_zone=1500) as bench:
        await bench.ready()
        await asyncio.sleep(0.5)
        straight = await reached(bench, Move(kind="straight", distance_m=0.4))
        assert straight.ahead_m == pytest.approx(0.4, abs=0.002)
        turn = await reached(bench, Move(kind="turn", angle_rad=1.0))
        assert turn.turned_rad == pytest.approx(1.0, abs=math.radians(0.5))
        home = await reached(bench, Move(kind="go_to", x=0.0, y=0.0, theta=0.0))
        assert math.hypot(home.end.x, home.end.y) < 0.005
        assert abs(math.remainder(home.end.theta, math.tau)) < math.radians(0.5)


@pytest.mark.usefixtures("vendors_rosmaster")
@ROSMASTER
@on_virtual_time
async def test_the_car_ends_where_its_pose_has_the_goal(tmp_path: Path) -> None:
    async with MoveBench(tmp_path, "r2", motor_dead_zone=1500) as bench:
        await bench.ready()
        await asyncio.sleep(0.5)
        straight = await reached(bench, Move(kind="straight", distance_m=0.4))
        assert straight.ahead_m == pytest.approx(0.4, abs=0.003)
        arc = await reached(bench, Move(kind="arc", radius_m=0.6, angle_rad=1.0))
        assert arc.turned_rad == pytest.approx(1.0, abs=0.05)
        await reached(bench, Move(kind="go_to", x=1.5, y=0.0, theta=0.0))
        pose = bench.heard.estimates[-1].pose
        assert math.hypot(pose.x - 1.5, pose.y) < 0.005
