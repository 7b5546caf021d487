"""A daemon that starts again continues from its last pose, if the board went on counting."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from made_boxes import HEADER, into
from robot_bench import RobotBench

from yahboomd.blackbox.kept_pose import PoseFile
from yahboomd.blackbox.ring import Ring
from yahboomd.core.model import OdometryEstimate, Pose2d, Twist2d
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.robot import SimulatedRobot
from yahboomd.simulation.virtual_time import on_virtual_time

START = Pose2d(x=1.0, y=2.0, theta=0.5)

SEGMENT_BYTES = 16 * 1024

Next = Callable[[], RobotBench]


@pytest.fixture
def daemons(tmp_path: Path) -> Callable[[str], Next]:
    """Makes one daemon after another, on one robot."""

    def of(dialect: str) -> Next:
        simulation = SimulationOptions(dialect=dialect, start_up_s=0.1)  # type: ignore[arg-type]
        robot = SimulatedRobot(simulation)

        def start() -> RobotBench:
            ring = Ring(into(bytearray(8 * SEGMENT_BYTES)), 0, SEGMENT_BYTES, 8)
            poses = PoseFile(tmp_path, HEADER)
            return RobotBench(tmp_path, (), simulation, ring=ring, poses=poses, robot=robot)

        return start

    return of


async def driven(bench: RobotBench, for_s: float = 3.0) -> Pose2d:
    """The last pose of a daemon that drove, from a place that was set."""
    async with bench:
        await bench.ready()
        bench.operator.set_pose(START, None)
        await bench.drive(for_s, 0.3, 0.2)
    return bench.controller._odometer.pose


def gaps(bench: RobotBench) -> list[tuple[str, str]]:
    kinds = ("odometry_bridged", "odometry_discontinuity")
    return [(e.kind, (e.data or {})["cause"]) for e in bench.heard.events if e.kind in kinds]


@pytest.mark.cases(1)
@pytest.mark.parametrize("away_s", [0.5, 120.0])
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_a_restarted_daemon_continues_where_the_board_went_on_counting(
    daemons: Callable[[str], Next], dialect: str, away_s: float
) -> None:
    start = daemons(dialect)
    before = await driven(start())
    await asyncio.sleep(away_s)
    async with (bench := start()):
        await bench.ready()
        await bench.until(lambda: bench.heard.estimates)
        pose = bench.heard.estimates[0].pose
        assert (pose.x, pose.y) == pytest.approx((before.x, before.y), abs=0.02)
        assert pose.theta == pytest.approx(before.theta, abs=0.1)
        assert gaps(bench) == [("odometry_bridged", "gap_kept")]
        assert bench.controller.status_values()["pose_broken"] == ""


@pytest.mark.cases(1)
@pytest.mark.parametrize(("away_s", "holds"), [(5.0, True), (120.0, False)])
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_a_board_that_was_reset_meanwhile_breaks_the_pose_until_it_is_set(
    daemons: Callable[[str], Next], dialect: str, away_s: float, holds: bool
) -> None:
    start = daemons(dialect)
    await driven(bench := start())
    bench.robot.reset(bench.clock.now_ns())
    await asyncio.sleep(away_s)
    async with (bench := start()):
        await bench.ready()
        await bench.until(lambda: bench.heard.estimates)
        pose = bench.heard.estimates[0].pose
        assert (pose.x > 1.0) == holds
        assert (pose == Pose2d()) != holds
        assert gaps(bench) == [("odometry_discontinuity", "gap_lost")]
        assert ("holds" if holds else "the pose broke") in bench.controller.status_values()[
            "pose_broken"
        ]
        bench.operator.set_pose(START, None)
        assert bench.controller.status_values()["pose_broken"] == ""


@on_virtual_time
async def test_the_pose_includes_what_a_killed_daemon_did_not_see(
    daemons: Callable[[str], Next],
) -> None:
    start = daemons("polled")
    bench = start()
    async with bench:
        await bench.ready()
        await bench.drive(3.0, 0.3)
        kept = bench.controller._odometer.pose
        bench.recorder = None
        # The last counts that it heard are older than its end: its guard stops the wheels.
        bench.controller._odometer._poses = None  # type: ignore[attr-defined]
        await bench.drive(0.1, 0.3)
    await asyncio.sleep(2.0)
    async with (bench := start()):
        await bench.until(lambda: bench.heard.estimates)
        assert 0.03 < bench.heard.estimates[0].pose.x - kept.x < 0.3
        assert gaps(bench) == [("odometry_bridged", "gap_kept")]


ESTIMATE = OdometryEstimate(
    stamp_ns=5_000_000_000,
    pose=START,
    twist=Twist2d(),
    pose_covariance=(0.1,) * 9,
    twist_covariance=(0.2,) * 9,
    motor_ticks=(1, 2),
    motor_position_rad=(0.1, 0.2),
    motor_speed_m_s=(0.1, 0.2),
)


def test_a_pose_is_kept_for_the_same_robot_in_the_same_boot_alone(tmp_path: Path) -> None:
    file = PoseFile(tmp_path, HEADER)
    assert file.last is None
    file.keep((1, 2, 3, 4), ESTIMATE)
    file.close()
    kept = PoseFile(tmp_path, HEADER).last
    assert kept is not None
    assert (kept.ticks, kept.estimate) == ((1, 2, 3, 4), ESTIMATE)
    other_boot = msgspec.structs.replace(HEADER, boot_id="another")
    other_port = msgspec.structs.replace(HEADER, config={"serial": {"port": "/dev/another"}})
    assert PoseFile(tmp_path, other_boot).last is None
    assert PoseFile(tmp_path, other_port).last is None
    assert PoseFile(tmp_path, HEADER, resume=False).last is None
    (path,) = [each for each in tmp_path.iterdir() if each.read_bytes()]
    path.write_bytes(path.read_bytes()[:100])
    assert PoseFile(tmp_path, HEADER).last is None
