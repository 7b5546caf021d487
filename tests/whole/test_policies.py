"""Arbitration and ends of commands, from payloads on the keys to the true wheels."""

from __future__ import annotations

import asyncio
import itertools
from pathlib import Path

import pytest
from fault_bench import FaultBench

from yahboomd.simulation.virtual_time import on_virtual_time

TELEOP = "cmd_vel/teleop"


@on_virtual_time
async def test_the_larger_priority_takes_over_and_gives_back_from_standstill_alone(
    tmp_path: Path,
) -> None:
    async with FaultBench(tmp_path) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.4)
        assert bench.controller.decision.driver == "cmd_vel"
        # A person takes over at once, against the one who goes on to command.
        before_ns = bench.clock.now_ns()
        drivers = []
        for _ in range(20):
            bench.command(0.4)
            bench.command(-0.3, source=TELEOP)
            bench.command(0.4)
            await asyncio.sleep(0.05)
            drivers.append(bench.controller.decision.driver)
        assert set(drivers) == {TELEOP}
        assert max(bench.rim_speeds) == pytest.approx(-0.3, abs=0.03)
        assert bench.arbiter.counters["lower_priority"] >= 38
        # The person lets go: their silence, standstill, and then the one who waits.
        taken_ns = None
        last_ns = bench.clock.now_ns()
        for _ in range(150):
            bench.command(0.4)
            await asyncio.sleep(0.01)
            if taken_ns is None and bench.controller.decision.driver == "cmd_vel":
                taken_ns = bench.clock.now_ns()
        assert taken_ns is not None
        assert taken_ns - last_ns > 0.25e9
        assert bench.arbiter.counters["not_standing"] > 0
        bench.robot.advance(bench.clock.now_ns())
        handed = [each for each in bench.truth if each.t_ns <= taken_ns][-1]
        assert max(map(abs, handed.speed_m_s)) < 0.03
        assert min(bench.rim_speeds) == pytest.approx(0.4, abs=0.03)
        # Never forward while the person had control.
        assert all(
            max(each.speed_m_s) < 0.03
            for each in bench.truth
            if before_ns + 500_000_000 < each.t_ns < taken_ns
        )


@on_virtual_time
async def test_limits_of_acceleration_deceleration_and_jerk_hold_on_the_wire(
    tmp_path: Path,
) -> None:
    limits = [
        "limits.linear={velocity=0.5, acceleration=0.6, deceleration=1.0, jerk=3.0}",
        "command.on_timeout=ramp",
    ]
    async with FaultBench(tmp_path, limits) as bench:
        await bench.ready()
        await bench.drive(2.5, 2.0)
        await asyncio.sleep(2.0)
        commanded = [(at_ns / 1e9, _left_m_s(order)) for at_ns, order in bench.orders]
        commanded = [(at_s, speed) for at_s, speed in commanded if speed is not None]
        assert max(speed for _, speed in commanded) == pytest.approx(0.5, abs=0.002)
        rates = [
            (at_s, (after - before) / (at_s - before_s))
            for (before_s, before), (at_s, after) in itertools.pairwise(_steps(commanded))
        ]
        assert max(rate for _, rate in rates) == pytest.approx(0.6, abs=0.12)
        assert min(rate for _, rate in rates) == pytest.approx(-1.0, abs=0.15)
        # Half of the acceleration is there no sooner than the jerk allows.
        start_s = next(at_s for at_s, speed in commanded if speed > 0.0)
        half_s = next(at_s for at_s, rate in rates if rate > 0.3)
        assert half_s - start_s >= 0.3 / 3.0 - 0.03


def _left_m_s(order: bytes) -> float | None:
    name, _, numbers = order.strip(b"$#").partition(b":")
    return int(numbers.split(b",")[0]) / 1000.0 if name == b"spd" else None


def _steps(commanded: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Speeds at least a control step apart: whole units in shorter ones look like leaps."""
    kept = commanded[:1]
    for each in commanded[1:]:
        if each[0] - kept[-1][0] >= 0.059:
            kept.append(each)
    return kept
