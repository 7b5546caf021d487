"""How much Python runs for a reading: a count, which no other program of the machine changes."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path
from types import FrameType
from typing import Self

import pytest
from robot_bench import RobotBench

from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time

ROOMS = tuple(f"yahboomd.{room}." for room in ("link", "protocol", "odometry", "drive", "daemon"))
CALLS_A_READING = {"polled": 115, "streamed": 70}


class Calls:
    """Counts calls of functions of the rooms between the port and the bus."""

    def __init__(self) -> None:
        self.count = 0

    def __enter__(self) -> Self:
        sys.setprofile(self._called)
        return self

    def __exit__(self, *_: object) -> None:
        sys.setprofile(None)

    def _called(self, frame: FrameType, event: str, _: object) -> None:
        if event == "call" and frame.f_globals.get("__name__", "").startswith(ROOMS):
            self.count += 1


@pytest.mark.parametrize("dialect", ["polled", "streamed"])
@on_virtual_time
async def test_a_reading_of_a_robot_that_stands_costs_few_calls(
    tmp_path: Path, dialect: str
) -> None:
    async with RobotBench(tmp_path, (), SimulationOptions(dialect=dialect)) as bench:
        await bench.ready()
        await bench.drive(0.5, 0.3)
        # Until the wheels have stood for a while, because earlier commands may still show.
        await asyncio.sleep(5.0)
        facts = bench.supervisor.status_values()
        with Calls() as calls:
            await asyncio.sleep(2.0)
        readings = bench.supervisor.status_values()["readings"] - facts["readings"]
    assert readings >= 90
    assert calls.count / readings <= CALLS_A_READING[dialect]
