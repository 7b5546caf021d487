"""Who hears of a time in which the process did not run."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from robot_bench import RobotBench

from yahboomd.simulation.virtual_time import VirtualTimeLoop, on_virtual_time


def freeze(for_s: float) -> None:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop)
    loop.freeze(for_s)


@on_virtual_time
async def test_a_pause_is_one_event_and_counted(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        await asyncio.sleep(5.0)
        assert "paused" not in bench.heard.kinds
        freeze(1.4)
        await asyncio.sleep(1.0)
        (event,) = [event for event in bench.heard.events if event.kind == "paused"]
        assert "yahboomd did not run for 1.4 s" in event.message
        assert bench.controller.facts()["pauses"] == 1


@on_virtual_time
async def test_a_pause_is_noticed_by_the_command_that_waited_for_its_end(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        freeze(1.4)
        bench.command(0.3)
        assert bench.arbiter.counters["after_pause"] == 1
        assert "paused" in bench.heard.kinds


@pytest.mark.parametrize("rate_hz", [1, 4, 200])
@on_virtual_time
async def test_a_control_path_that_runs_seldom_is_no_pause(tmp_path: Path, rate_hz: int) -> None:
    overrides = [
        f"command.rate_hz={rate_hz}",
        "command.timeout_s=5",
        'command.sources={"cmd_vel"={priority=10}}',
    ]
    async with RobotBench(tmp_path, overrides) as bench:
        await asyncio.sleep(5.0)
        assert bench.controller.counters["pauses"] == 0
