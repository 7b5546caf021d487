"""Random driving with the operators' commands, on the vendor's firmware 1.7.3.

Six seconds of three motors; with YAHBOOMD_FIRMWARE_LONG ten minutes of each.
"""

from __future__ import annotations

import asyncio
import math
from pathlib import Path
from random import Random

import pytest
from fault_bench import FaultBench
from vendor_firmware import KINDS, LONG, ON_THE_FIRMWARE, kinds

from yahboomd.core.model import NS_PER_S
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time

pytestmark = ON_THE_FIRMWARE

SECONDS = 600 if LONG else 6
ALARMS = {
    *("runaway_against", "runaway_fast", "turns_without_command", "no_counts", "stop_not_obeyed"),
    *("board_reset", "disconnected", "odometry_discontinuity", "rolled", "line_noisy"),
}
STIFF = "54 %, 550 rev/min"
"""It needs more than the stored dead zone gives; wild reversals accuse it until it is tuned."""


async def operate(bench: FaultBench, chance: Random) -> None:
    """One of the operators' commands, and what it answers."""
    match chance.randrange(3):
        case 0:
            assert "engaged" in bench.operator.engage_estop("a test")
            engaged_ns = bench.clock.now_ns()
            await asyncio.sleep(1.6)
            assert bench.stood_at(engaged_ns) - engaged_ns < 1_500_000_000
            bench.command(0.5)
            await asyncio.sleep(0.1)
            assert bench.standing
            assert not bench.operator.release_estop()[0], "a source commands motion"
            await asyncio.sleep(1.2)
            assert bench.operator.release_estop()[0]
        case 1:
            bench.command(0.0)
            await asyncio.sleep(2.0)
            bench.operator.set_pose(bench.heard.estimates[-1].pose, None)
        case 2:
            await asyncio.sleep(chance.choice([0.3, 0.7, 4.0]))


@pytest.mark.parametrize("motor", kinds(2))
@on_virtual_time
async def test_random_driving_raises_no_alarm_obeys_every_stop_and_its_pose_is_true(
    tmp_path: Path, motor: str
) -> None:
    chance = Random(f"{motor} {SECONDS}")
    limits = ["limits.linear={velocity=0.6, acceleration=1.0, deceleration=1.5}"]
    async with FaultBench(tmp_path, limits, SimulationOptions(**KINDS[motor])) as bench:
        await bench.ready()
        until_ns = bench.clock.now_ns() + SECONDS * NS_PER_S
        while bench.clock.now_ns() < until_ns:
            vx = chance.choice([0.0, 0.05, 0.1, 0.2, 0.4, 0.6]) * chance.choice([1, -1])
            wz = chance.choice([0.0, 0.0, 0.3, 1.0, 2.0]) * chance.choice([1, -1])
            await bench.drive(chance.choice([0.1, 0.3, 0.6, 1.2, 2.0]), vx, wz)
            if chance.random() < 0.3:
                await operate(bench, chance)
        bench.command(0.0)
        await asyncio.sleep(2.0)
        assert bench.standing
        known = {"no_counts", "line_noisy"} if motor == STIFF and SECONDS > 60 else set()
        assert not (ALARMS - known) & {*bench.heard.kinds}
        truth = bench.robot.truth(bench.clock.now_ns())
        pose = bench.heard.estimates[-1].pose
        assert math.hypot(pose.x - truth.x, pose.y - truth.y) < 0.05
        assert pose.theta == pytest.approx(truth.theta, abs=0.05)
