"""The watchdog is fed however often commands come between."""

from __future__ import annotations

import asyncio
from itertools import pairwise
from pathlib import Path
from typing import Literal

import pytest
from robot_bench import RobotBench

from yahboomd.core.clock import seconds
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time


@pytest.mark.cases(1)
@pytest.mark.parametrize(("dialect", "rate_hz"), [("streamed", 100), ("polled", 50)])
@on_virtual_time
async def test_commands_however_often_they_come_leave_the_watchdog_fed(
    tmp_path: Path, dialect: Literal["streamed", "polled"], rate_hz: int
) -> None:
    async with RobotBench(tmp_path, (), SimulationOptions(dialect=dialect)) as bench:
        await bench.ready()
        for _ in range(3 * rate_hz):
            bench.command(0.3)
            await asyncio.sleep(1 / rate_hz)
        beats = [*bench.beats, bench.clock.now_ns()]
    # systemd kills a daemon that is silent for 2 s; it is fed in the first beat after a third.
    assert max(seconds(after - before) for before, after in pairwise(beats)) < 0.3
