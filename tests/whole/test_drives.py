"""Every drive geometry from a command on its key to the wheels, and back to the pose."""

from __future__ import annotations

import asyncio
import math
from pathlib import Path

import pytest
from fault_bench import TICK_M, FaultBench
from robot_bench import RobotBench
from vendor_firmware import STICKING

from yahboomd.core.messages.codecs import encode
from yahboomd.core.messages.native import VelocityCommand
from yahboomd.core.model import Twist2d
from yahboomd.simulation.options import PLAIN_GAIN, SimulationOptions, Wiring
from yahboomd.simulation.truth import TruthSample
from yahboomd.simulation.virtual_time import on_virtual_time

TRACK_M = 0.15
BASE_M = 0.13
DRIVES = {
    "2wd": ("differential", ()),
    "4wd": ("skid_steer", ()),
    "mecanum": ("mecanum", (f"chassis.wheel_base_m={BASE_M}",)),
}


def robot(folder: Path, preset: str, dialect: str, *overrides: str) -> FaultBench:
    drive, more = DRIVES[preset]
    simulation = {
        "dialect": dialect,
        "drive": drive,
        "wheel_separation_m": TRACK_M,
        "wheel_base_m": BASE_M,
    }
    return FaultBench(
        folder,
        [f"chassis.preset={preset}", *more, *overrides],
        SimulationOptions(**simulation),  # type: ignore[arg-type]
    )


async def say(bench: RobotBench, twist: Twist2d, for_s: float) -> None:
    payload = encode(VelocityCommand(vx=twist.vx, vy=twist.vy, wz=twist.wz), "json")
    for _ in range(round(for_s / 0.05)):
        bench.payload(payload)
        await asyncio.sleep(0.05)


def steady_truth(bench: FaultBench, over_s: float) -> Twist2d:
    """The true velocity, averaged over the last moments."""
    bench.robot.advance(bench.clock.now_ns())
    since_ns = bench.truth[-1].t_ns - round(over_s * 1e9)
    seen = [each for each in bench.truth if each.t_ns >= since_ns]
    return Twist2d(
        vx=sum(each.vx for each in seen) / len(seen),
        vy=sum(each.vy for each in seen) / len(seen),
        wz=sum(each.wz for each in seen) / len(seen),
    )


def steady_estimate(bench: FaultBench, over_s: float) -> Twist2d:
    """The same of the odometry's estimate."""
    since_ns = bench.heard.estimates[-1].stamp_ns - round(over_s * 1e9)
    seen = [each.twist for each in bench.heard.estimates if each.stamp_ns >= since_ns]
    return Twist2d(
        vx=sum(each.vx for each in seen) / len(seen),
        vy=sum(each.vy for each in seen) / len(seen),
        wz=sum(each.wz for each in seen) / len(seen),
    )


def assert_at_truth(bench: FaultBench) -> TruthSample:
    """The odometry's pose is the robot's, up to the encoders' resolution."""
    bench.robot.advance(bench.clock.now_ns())
    pose, truth = bench.heard.estimates[-1].pose, bench.truth[-1]
    assert math.hypot(pose.x - truth.x, pose.y - truth.y) < 0.008
    assert abs(pose.theta - truth.theta) <= 2 * TICK_M / TRACK_M
    return truth


@pytest.mark.cases(1)
@pytest.mark.parametrize("preset", ["2wd", "4wd", "mecanum"])
@on_virtual_time
async def test_a_wish_beyond_the_wheels_is_slower_on_the_same_curve(
    tmp_path: Path, preset: str
) -> None:
    wish = Twist2d(vx=1.0, vy=0.5 if preset == "mecanum" else 0.0, wz=5.0)
    async with robot(tmp_path, preset, "streamed") as bench:
        await bench.ready()
        await say(bench, wish, 3.0)
        true = steady_truth(bench, 1.0)
        assert bench.controller.counters["desaturated"] > 0
        assert true.vx < 0.8
        assert true.wz / true.vx == pytest.approx(wish.wz / wish.vx, rel=0.02)
        assert true.vy / true.vx == pytest.approx(wish.vy / wish.vx, abs=0.02)
        await asyncio.sleep(1.5)
        assert_at_truth(bench)


@on_virtual_time
async def test_a_motor_in_another_place_the_other_way_round_is_a_matter_of_configuration(
    tmp_path: Path,
) -> None:
    wiring = (
        Wiring(name="left", position=4, corner="left", command_sign=-1, encoder_sign=-1),
        Wiring(name="right", position=2, corner="right"),
    )
    motors = (
        "chassis.motors.left=[{position=4, command_sign=-1, encoder_sign=-1}]",
        "chassis.motors.right=[{position=2, command_sign=1, encoder_sign=1}]",
    )
    simulation = SimulationOptions(wiring=wiring, wheel_separation_m=TRACK_M)
    async with FaultBench(tmp_path, motors, simulation) as bench:
        await bench.ready()
        await say(bench, Twist2d(vx=0.3, wz=0.6), 2.0)
        true = steady_truth(bench, 0.5)
        assert (true.vx, true.wz) == pytest.approx((0.3, 0.6), abs=0.05)
        await asyncio.sleep(1.5)
        assert_at_truth(bench)


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", ["streamed", "polled"])
@on_virtual_time
async def test_the_command_scale_is_a_multiplier_of_the_speed_and_not_of_the_counts(
    tmp_path: Path, dialect: str
) -> None:
    async with robot(tmp_path, "2wd", dialect, "chassis.command_scale=1.2") as bench:
        await bench.ready()
        await say(bench, Twist2d(vx=0.3), 2.0)
        assert steady_truth(bench, 0.5).vx == pytest.approx(0.36, abs=0.01)
        assert steady_estimate(bench, 0.5).vx == pytest.approx(0.36, abs=0.01)
        await asyncio.sleep(1.5)
        assert_at_truth(bench)


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", ["streamed", "polled", "rosmaster"])
@on_virtual_time
async def test_slip_of_the_rollers_is_made_up_for_in_commands_and_in_odometry(
    tmp_path: Path, dialect: str
) -> None:
    preset = ("chassis.preset=mecanum", f"chassis.wheel_base_m={BASE_M}")
    sideways = "chassis.sideways_multiplier=0.85"
    simulation = SimulationOptions(
        dialect=dialect,
        drive="mecanum",
        wheel_separation_m=TRACK_M,
        wheel_base_m=BASE_M,
        sideways=0.85,
        max_speed_m_s=1.5,
    )
    async with FaultBench(tmp_path, [*preset, sideways], simulation) as bench:
        await bench.ready()
        wish = Twist2d(vx=0.1, vy=0.25, wz=0.3)
        await say(bench, wish, 3.0)
        truth = steady_truth(bench, 0.5)
        assert (truth.vx, truth.vy, truth.wz) == pytest.approx((0.1, 0.25, 0.3), abs=0.02)
        estimate = bench.heard.estimates[-1]
        assert estimate.twist.vy == pytest.approx(truth.vy, abs=0.02)
        await asyncio.sleep(1.0)
        pose, place = bench.heard.estimates[-1].pose, bench.robot.truth(bench.clock.now_ns())
        assert math.hypot(pose.x - place.x, pose.y - place.y) < 0.01


@on_virtual_time
async def test_backward_docking_at_a_crawl_on_a_sticking_floor_keeps_the_pose(
    tmp_path: Path,
) -> None:
    motors = STICKING["40 %, sticks"] | {"loop_gain": PLAIN_GAIN}
    async with FaultBench(tmp_path, (), SimulationOptions(**motors)) as bench:
        await bench.ready()
        await asyncio.sleep(0.3)
        # By odometry alone, as a docking does it; 0.3 m take 6 s.
        async with asyncio.timeout(8.0):
            while not bench.heard.estimates or bench.heard.estimates[-1].pose.x > -0.3:
                await bench.drive(0.05, -0.05)
        bench.command()
        await bench.until(lambda: bench.standing)
        await asyncio.sleep(0.5)
        assert -0.32 < assert_at_truth(bench).x < -0.30
        assert bench.heard.kinds == ["connected"]
