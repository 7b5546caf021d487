"""Moves on the vendor's firmware 1.7.3, on virtual time."""

from __future__ import annotations

import asyncio
import math
from pathlib import Path
from typing import Any

import pytest
from vendor_firmware import MOTORS, ON_THE_FIRMWARE, of_all

from benchmarks.move_bench import MoveBench
from yahboomd.client.move_messages import Move
from yahboomd.simulation.virtual_time import on_virtual_time

pytestmark = ON_THE_FIRMWARE


FIT = [name for name, motor in MOTORS.items() if motor["motor_dead_zone"] < 1650]
TRIED = of_all(FIT, every=len(FIT))
"""Motors that turn at what the firmware is set to; others need more at low speeds than it gives."""


@pytest.mark.parametrize("motor", TRIED)
@on_virtual_time
async def test_moves_end_where_they_should(tmp_path: Path, motor: str) -> None:
    simulation: dict[str, Any] = {"rated_volts": 7.4, "battery_volts": 7.4, **MOTORS[motor]}
    lag_s = simulation.pop("time_constant_s")
    async with MoveBench(tmp_path, "2wd", lag_s, **simulation) as bench:
        await bench.ready()
        await asyncio.sleep(0.3)
        straight = await bench.move([Move(kind="straight", distance_m=0.4)])
        assert straight.ended.reason == "reached", straight.ended
        assert straight.ahead_m == pytest.approx(0.4, abs=0.002)
        turn = await bench.move([Move(kind="turn", angle_rad=1.0)])
        assert turn.ended.reason == "reached", turn.ended
        assert turn.turned_rad == pytest.approx(1.0, abs=math.radians(0.5))
        home = await bench.move([Move(kind="go_to", x=0.0, y=0.0, backward=True)])
        assert home.ended.reason == "reached", home.ended
        assert math.hypot(home.end.x, home.end.y) < 0.005
