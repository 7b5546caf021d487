"""From a black box the pure rooms compute the poses that the daemon published, bit by bit."""

from __future__ import annotations

import asyncio
import math
import random
from pathlib import Path

import msgspec
import pytest
from made_boxes import into
from robot_bench import RobotBench

from yahboomd.blackbox import records
from yahboomd.blackbox.box_file import encode_header, read_box
from yahboomd.blackbox.box_keeper import header
from yahboomd.blackbox.ring import Ring
from yahboomd.core.model import Pose2d
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.replay.replayed_poses import PoseReplay

SEGMENT_BYTES = 16 * 1024


def bench_and_image(folder: Path, dialect: str, overrides: list[str]):
    """A robot whose ring is so small that it goes round several times in a test."""
    buffer = bytearray(6 * SEGMENT_BYTES)
    ring = Ring(into(buffer), 0, SEGMENT_BYTES, 6)
    simulation = SimulationOptions(dialect=dialect)  # type: ignore[arg-type]
    bench = RobotBench(folder, overrides, simulation, ring=ring)

    def box():
        words = header(bench.config, bench.clock)
        head = encode_header(msgspec.structs.replace(words, segment_bytes=SEGMENT_BYTES))
        return read_box(head + bytes(buffer))

    return bench, box


def assert_same_to_the_last_bit(box, published) -> int:
    replay = PoseReplay(box.header)
    replay.run(box.records)
    assert box.damaged == 0
    # From the first anchor to the newest one none is left out. Of lines that were read together the
    # daemon published the last one's alone.
    found = {each.estimate.stamp_ns: each.estimate for each in replay.estimates}
    newest = [each for each in published if each.stamp_ns >= min(found)]
    assert [found.get(each.stamp_ns) for each in newest] == newest
    compared = replay.compared
    assert compared.same
    assert compared.moments == compared.identical > 0
    return len(found)


@pytest.mark.cases(1)
@pytest.mark.parametrize("heading", ["wheels", "fused"])
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_poses_from_a_box_are_those_that_were_published_to_the_last_bit(
    tmp_path: Path, dialect: str, heading: str
) -> None:
    """The ring has gone round, several lines were read at once, the line lost and garbled bytes,
    the board was reset and unplugged, and the pose was set."""
    chance = random.Random(3)
    bench, box = bench_and_image(tmp_path, dialect, [f"odometry.heading={heading}"])
    compared = 0
    async with bench:
        await bench.ready()
        for round_number in range(4):
            for _ in range(2):
                await bench.drive(1.0, chance.uniform(-0.3, 0.4), chance.uniform(-1.0, 1.0))
            compared += assert_same_to_the_last_bit(box(), bench.heard.estimates)
            bench.robot.impairments.change(corruption=0.002 * (round_number % 2))
            bench.operator.set_pose(Pose2d(x=1.0, theta=math.pi), None)
            if round_number == 1:
                bench.robot.reset(bench.clock.now_ns())
            if round_number == 2:
                bench.robot.unplug(bench.clock.now_ns(), 1.0)
                await asyncio.sleep(3.0)
        found = box()
        assert_same_to_the_last_bit(found, bench.heard.estimates)
    kinds = {type(record.meaning) for record in found.records}
    assert {
        records.Received,
        records.Written,
        records.Anchor,
        records.Posed,
        records.CommandRecord,
    } <= kinds
    # A Rosmaster starts for 12 s after the reset.
    assert compared > 300
