"""The captures of `tests/tools/replay/captures`: short drives of simulated boards, as black boxes.

`PYTHONPATH=.:tests/plugins python tests/tools/replay/replay_captures.py` makes them again, with
their golden poses. They begin with a fresh odometer and hold no later state of it, so that they
can be computed by any version.
"""

from __future__ import annotations

import asyncio
import json
import math
import tempfile
from pathlib import Path

import msgspec
from wire_records import WireBench, save

from yahboomd.blackbox.records import Anchor, Record
from yahboomd.core.model import OdometryEstimate, Pose2d
from yahboomd.simulation import virtual_time
from yahboomd.simulation.options import ImpairmentOptions
from yahboomd.tools.replay.replayed_poses import KINDS

FOLDER = Path(__file__).with_name("captures")

HEADINGS = {"streamed": "wheels", "polled": "wheels", "rosmaster": "fused"}
"""The boards, each with the heading that it is recorded with."""

EVERY = 25
"""Estimates from one golden pose to the next."""


def golden(estimates: list[OdometryEstimate]) -> list[list[float]]:
    """Some of the poses, the last one among them: stamp, x, y, heading, and the variances."""
    return [
        [each.stamp_ns, each.pose.x, each.pose.y, each.pose.theta, *each.pose_covariance[::4]]
        for each in (*estimates[:-1:EVERY], estimates[-1])
    ]


async def _drive(folder: Path, dialect: str) -> WireBench:
    line = ImpairmentOptions(jitter_s=0.004)
    heading = f"odometry.heading={HEADINGS[dialect]}"
    async with WireBench(folder, dialect, heading, impairments=line) as bench:
        await bench.ready()
        await asyncio.sleep(0.5)
        await bench.drive(2.0, 0.3, 0.8)
        await bench.drive(1.0, -0.25, 0.5)
        bench.operator.set_pose(Pose2d(x=1.0, y=-2.0, theta=math.pi / 2.0), None)
        bench.robot.impairments.change(corruption=0.002)
        await bench.drive(1.5, 0.4, -0.6)
        bench.robot.impairments.change(corruption=0.0)
        if dialect == "polled":
            bench.robot.unplug(bench.clock.now_ns(), 1.0)
            await asyncio.sleep(1.5)
        else:
            bench.robot.reset(bench.clock.now_ns())
            await asyncio.sleep(1.5)
        await bench.drive(1.5, 0.3, 0.4)
        await asyncio.sleep(0.5)
    return bench


def make() -> None:
    """Write the captures, and their golden poses."""
    FOLDER.mkdir(exist_ok=True)
    for dialect in HEADINGS:
        with tempfile.TemporaryDirectory() as folder:
            bench = virtual_time.run(_drive(Path(folder), dialect))
        first = bench.records[0]
        assert isinstance(first.meaning, Anchor)
        bench.records[0] = Record(first.at_ns, msgspec.structs.replace(first.meaning, state=b""))
        save(FOLDER / f"{dialect}.box", bench)
        estimates = bench.heard.estimates
        facts = {
            "recorded": f"from the simulated {dialect} board of this tree, not from a real one",
            "estimates": len(estimates),
            "events": [each.kind for each in bench.heard.events if each.kind in KINDS],
            "columns": ["stamp_ns", "x", "y", "theta", "var_x", "var_y", "var_theta"],
        }
        lines = [json.dumps(each) for each in golden(estimates)]
        words = json.dumps(facts, indent=1)[:-2]
        poses = ",\n  ".join(lines)
        (FOLDER / f"{dialect}.json").write_text(f'{words},\n "poses": [\n  {poses}\n ]\n}}\n')


if __name__ == "__main__":
    make()
