"""The pose goes on through every fault: it never jumps, and unknown travel is reported.

On virtual time, against the ground truth of the simulated robot.
"""

from __future__ import annotations

import asyncio
import math
import random
from pathlib import Path

import pytest
from fault_bench import (
    DIALECTS,
    OURS_ALONE,
    FaultBench,
    assert_covariance_grows,
    assert_no_jump,
)

from yahboomd.core.model import OdometryEstimate
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.truth import pose_at
from yahboomd.simulation.virtual_time import on_virtual_time

FAR = (60_000, 0, 60_000, 0)
"""Counters of a board that has been driven: far from those after a reset."""


def robot(tmp_path: Path, *overrides: str, **simulation: object) -> FaultBench:
    options = {"wheel_separation_m": 0.15, "initial_ticks": FAR, **simulation}
    return FaultBench(tmp_path, overrides, SimulationOptions(**options))  # type: ignore[arg-type]


def error_m(bench: FaultBench, estimate: OdometryEstimate) -> float:
    """The distance of an estimate from the truth of its moment."""
    # At rest the last sample is as good as the next.
    truth = pose_at(bench.truth, min(estimate.stamp_ns, bench.truth[-1].t_ns))
    return math.hypot(estimate.pose.x - truth.x, estimate.pose.y - truth.y)


def unknown_m(bench: FaultBench) -> float:
    """The travel of a wheel that events report as unknown."""
    return said_m(bench, "unknown_m")


def unsure_m(bench: FaultBench) -> float:
    """The distance beside the pose that events allow the base."""
    return said_m(bench, "unsure_m")


def said_m(bench: FaultBench, what: str) -> float:
    return sum(
        float(event.data[what])  # type: ignore[arg-type]
        for event in bench.heard.events
        if event.data is not None and what in event.data
    )


@pytest.mark.cases(1)
@pytest.mark.parametrize("away_s", [0.1, 1.0, 4.0])
@pytest.mark.parametrize("fault", ["unplug", "mute", "babble"])
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_what_the_board_counted_unheard_is_in_the_pose_afterwards(
    tmp_path: Path, dialect: str, fault: str, away_s: float
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        await bench.drive(2.0, 0.3)
        bench.do(f"{fault} {away_s}")
        await bench.drive(away_s, 0.3)
        await asyncio.sleep(3.5)
        error = error_m(bench, bench.heard.estimates[-1])
        print(f"{error * 1000:.1f} mm off, {unsure_m(bench) * 1000:.1f} mm unsure")
        # The counts are complete; in which order it went and turned meanwhile, they do not tell.
        assert error < 0.003 + unsure_m(bench)
        assert error < 0.01
        assert unknown_m(bench) == 0.0
        assert_no_jump(bench.heard.estimates)
        assert_covariance_grows(bench.heard.estimates)


NEAR_ZERO = (0, 0, 0, 0)


@pytest.mark.cases(1)
@pytest.mark.parametrize("away_s", [0.05, 0.4, 1.0, 4.0, 20.0])
@on_virtual_time
async def test_a_replug_keeps_the_pose_near_zero_too_where_the_stream_ran_on(
    tmp_path: Path, away_s: float
) -> None:
    async with robot(tmp_path, initial_ticks=NEAR_ZERO) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        for _ in range(2):
            bench.do(f"unplug {away_s}")
            await bench.drive(away_s, 0.3)
            await asyncio.sleep(3.5)
            await bench.drive(1.0, -0.3)
            await asyncio.sleep(1.0)
        assert bench.heard.kinds.count("odometry_bridged") == 2
        assert unknown_m(bench) == 0.0
        # The wheels are unequal, and travel in a gap is taken for an arc: 1 mm in a metre.
        assert error_m(bench, bench.heard.estimates[-1]) < max(0.006, 1e-3 * 2 * 0.3 * away_s)
        assert_no_jump(bench.heard.estimates)
        assert_covariance_grows(bench.heard.estimates)


@on_virtual_time
async def test_where_a_reset_is_possible_the_pose_holds_and_an_event_says_what_is_unknown(
    tmp_path: Path,
) -> None:
    async with robot(tmp_path, dialect="polled", initial_ticks=NEAR_ZERO) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        before = bench.heard.estimates[-1]
        bench.do("unplug 1")
        await asyncio.sleep(4.0)
        after = bench.heard.estimates[-1]
        event = next(e for e in bench.heard.events if e.kind == "odometry_discontinuity")
        assert event.data is not None
        assert event.data["cause"] == "gap_lost"
        assert "The pose holds" in event.message
        assert math.hypot(after.pose.x - before.pose.x, after.pose.y - before.pose.y) < 0.05
        lost_m = error_m(bench, after)
        assert 0.1 < lost_m < unknown_m(bench)
        # Three standard deviations of the published pose cover the lost travel.
        assert 3.0 * math.sqrt(after.pose_covariance[0]) > lost_m
        assert_no_jump(bench.heard.estimates)


@pytest.mark.cases(1)
@pytest.mark.parametrize("again_s", [None, 0.0, 0.002, 0.004, 0.01, 0.05, 0.3])
@pytest.mark.parametrize("fault", ["reset", "brown-out 0.05"])
@on_virtual_time
async def test_a_reset_while_the_plug_is_out_is_no_travel_even_where_the_plug_comes_out_again(
    tmp_path: Path, fault: str, again_s: float | None
) -> None:
    async with robot(tmp_path, initial_ticks=NEAR_ZERO) as bench:
        await bench.ready()
        await bench.drive(2.0, 0.3)
        bench.do("unplug")
        await asyncio.sleep(1.0)
        rolled = bench.heard.estimates[-1]
        bench.do(fault)
        await asyncio.sleep(1.0)
        bench.do("replug")
        if again_s is not None:
            # The stream is on again by then, and little or nothing was heard of it.
            armed = b"$upload:1,0,0#"
            await bench.until(lambda: not bench.ports[-1].closed and armed in bench.frames)
            await asyncio.sleep(again_s)
            bench.do("unplug 0.5")
        await asyncio.sleep(4.0)
        after = bench.heard.estimates[-1]
        assert math.hypot(after.pose.x - rolled.pose.x, after.pose.y - rolled.pose.y) < 0.02
        assert bench.events("odometry_discontinuity")
        assert 3.0 * math.sqrt(after.pose_covariance[0]) > error_m(bench, after)


@pytest.mark.cases(1)
@pytest.mark.parametrize("fault", ["reset", "brown-out 0.05", "brown-out 0.5"])
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_after_a_reset_the_pose_holds_and_an_event_says_how_much_is_unknown(
    tmp_path: Path, dialect: str, fault: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        await bench.drive(2.0, 0.3)
        before = bench.heard.estimates[-1]
        bench.do(fault)
        await bench.drive(4.0, 0.3)
        await asyncio.sleep(1.5)
        after = bench.heard.estimates[-1]
        lost_m = error_m(bench, after)
        reported_m = unknown_m(bench)
        print(
            f"{dialect}, {fault}: {lost_m * 1000:.0f} mm lost, {reported_m * 1000:.0f} mm reported"
        )
        assert lost_m < reported_m
        assert bench.events("odometry_discontinuity")
        # The covariance has the reported travel: three standard deviations cover it.
        grown = after.pose_covariance[0] - before.pose_covariance[0]
        assert 3.0 * math.sqrt(grown) > lost_m
        assert_no_jump(bench.heard.estimates)
        assert_covariance_grows(bench.heard.estimates)


@on_virtual_time
async def test_an_ordinary_drive_leaves_no_event_and_errs_by_millimetres(tmp_path: Path) -> None:
    async with robot(tmp_path) as bench:
        await bench.ready()
        await bench.drive(5.0, 0.3, 0.8)
        await asyncio.sleep(1.5)
        assert error_m(bench, bench.heard.estimates[-1]) < 0.008
        assert set(bench.heard.kinds) == {"connected"}


FAULTS = [
    "reset",
    "brown-out 0.05",
    "brown-out 0.4",
    "mute 0.1",
    "mute 0.6",
    "mute 2",
    "babble 0.05",
    "babble 0.7",
    "unplug 0.05",
    "unplug 0.4",
    "unplug 2",
    "loss 0.01",
    "loss 0.05",
    "loss 0.2",
    "corruption 0.01",
    "corruption 0.1",
    "delay 0.01 0.01",
    "chunk 0.016",
    "clear",
    "clear",
    "stalled left",
    "encoder-dead right",
    "turning left 0.2",
    "repair all",
    "repair all",
    "hang",
]


SEQUENCES = [(DIALECTS[seed % 2], seed) for seed in range(20)]
SEQUENCES += [(dialect, seed) for dialect in OURS_ALONE for seed in range(30, 45)]


@pytest.mark.cases(1)
@pytest.mark.parametrize(("dialect", "seed"), SEQUENCES)
@on_virtual_time
async def test_no_sequence_of_faults_makes_the_pose_jump_or_the_covariance_shrink(
    tmp_path: Path, dialect: str, seed: int
) -> None:
    chance = random.Random(seed)
    start = chance.choice([0, 40, 3000, 2**31 - 3000, -(2**31) + 500])
    options = {
        "dialect": dialect,
        "seed": seed,
        "initial_ticks": (start, 0, -start if start != -(2**31) else 0, 0),
    }
    async with robot(tmp_path, **options) as bench:
        await bench.ready()
        done = []
        for _ in range(8):
            fault = chance.choice(FAULTS)
            done.append(fault)
            bench.do(fault)
            await bench.drive(
                chance.choice([0.1, 0.4, 1.0, 2.5]),
                chance.uniform(-0.6, 0.6),
                chance.uniform(-2.0, 2.0),
            )
            if fault == "hang":
                bench.do("reset")
            if chance.random() < 0.4:
                bench.operator.release_estop()
        assert not any(task.done() for task in bench.tasks), done
        assert_no_jump(bench.heard.estimates)
        assert_covariance_grows(bench.heard.estimates)
        # It comes to rest, and back, whatever has been.
        bench.do("clear")
        bench.do("repair all")
        await asyncio.sleep(6.0)
        if bench.controller.state()[0] == "waiting":
            # A damaged command can hang the MCU with its motors on, until a reset.
            bench.do("reset")
            await asyncio.sleep(6.0)
        assert bench.standing, done
        bench.operator.release_estop()
        await bench.drive(1.5, 0.3)
        if not any(bench.rim_speeds):
            # It was reset unnoticed and had forgotten its motors. The next command drives again.
            await asyncio.sleep(1.0)
            await bench.drive(1.5, 0.3)
        assert min(bench.rim_speeds) > 0.2, (done, bench.controller.state())
        assert_no_jump(bench.heard.estimates)
