"""Lists of moves on simulated robots of every geometry, judged by their true poses."""

from __future__ import annotations

import asyncio
import math
from pathlib import Path

import pytest
from move_bench import Drive, MoveBench

from yahboomd.client.move_messages import Move
from yahboomd.core.model import Pose2d, Twist2d
from yahboomd.moves.motion.base_limits import Base
from yahboomd.moves.motion.lag_model import LagModel
from yahboomd.moves.motion.move_plan import MoveRefused
from yahboomd.moves.motion.mover import Mover
from yahboomd.moves.motion.speed_profile import SpeedLimits
from yahboomd.simulation.motors import MotorFaults
from yahboomd.simulation.options import PLAIN_GAIN, SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time

WAVE = tuple((0.02 * i, 0.15 * math.sin(0.08 * i)) for i in range(1, 36))
BASE = Base(
    way=SpeedLimits(speed=1.0, acceleration=2.5, braking=5.0, jerk=math.inf),
    turn=SpeedLimits(speed=6.0, acceleration=12.0, braking=24.0, jerk=math.inf),
)
STEP_NS = 20_000_000
STICKS = [(10.5, 90.0), (12.0, 90.0), (12.0, 10.0), (10.5, 10.0)]


async def drive(bench: MoveBench, *moves: Move) -> Drive:
    driven = await bench.move(moves)
    assert driven.ended.reason == "reached", driven.ended
    return driven


def off_the_wave(pose: Pose2d) -> float:
    return min(math.hypot(pose.x - x, pose.y - y) for x, y in ((0.0, 0.0), *WAVE))


@pytest.mark.parametrize(
    ("preset", "lag_s"),
    [
        ("2wd", 0.2),
        *(
            pytest.param(*case, marks=pytest.mark.nightly)
            for case in (("2wd", 0.05), ("4wd", 0.2), ("mecanum", 0.05))
        ),
    ],
)
@on_virtual_time
async def test_moves_end_where_they_should(tmp_path: Path, preset: str, lag_s: float) -> None:
    async with MoveBench(tmp_path, preset, lag_s) as bench:
        await bench.ready()
        straight = await drive(bench, Move(kind="straight", distance_m=0.5))
        assert straight.ahead_m == pytest.approx(0.5, abs=0.002)
        assert abs(straight.left_m) < 0.002
        turn = await drive(bench, Move(kind="turn", angle_rad=-math.pi / 2.0))
        assert turn.turned_rad == pytest.approx(-math.pi / 2.0, abs=math.radians(0.35))
        back = await drive(bench, Move(kind="straight", distance_m=-0.2))
        assert back.ahead_m == pytest.approx(-0.2, abs=0.002)
        home = await drive(bench, Move(kind="go_to", x=0.0, y=0.0, theta=0.0))
        assert math.hypot(home.end.x, home.end.y) < 0.005
        assert math.remainder(home.end.theta, 2.0 * math.pi) == pytest.approx(
            0.0, abs=math.radians(0.5)
        )
        wave = await drive(bench, Move(kind="follow", points=WAVE))
        # The points are 20 mm apart: half of that is no error.
        assert max(off_the_wave(pose) for pose in wave.path) < math.hypot(0.0125, 0.01)
        assert home.time_s <= home.ideal_s + 3.0 * lag_s + 0.6
        for each in (straight, back):
            assert each.time_s <= each.ideal_s + 3.0 * lag_s + 0.7


@on_virtual_time
async def test_the_default_robot_turns_by_a_quarter_as_a_newcomer_asks(tmp_path: Path) -> None:
    """Its wheels begin to turn at 55 to 61 % of the output; the board adds 44 %."""
    robot = SimulationOptions()
    options = {name: getattr(robot, name) for name in ("rated_volts", "battery_volts")}
    bench = MoveBench(
        tmp_path, "2wd", robot.time_constant_s, motor_dead_zone=robot.motor_dead_zone, **options
    )
    async with bench:
        await bench.ready()
        await asyncio.sleep(0.5)
        await drive(bench, Move(kind="straight", distance_m=0.5))
        turn = await drive(bench, Move(kind="turn", angle_rad=math.pi / 2.0))
        assert turn.turned_rad == pytest.approx(math.pi / 2.0, abs=math.radians(1.0))


STICKING = {
    "rated_volts": 12.0,
    "motor_dead_zone": 1440,
    "friction_scales": (1.05, 1.075, 0.975, 1.0),
    "sticks": (1.2,),
    "loop_gain": PLAIN_GAIN,
}
"""The floor of an X3: 47 to 52 % of full output at 12 V begins to turn a wheel."""


@pytest.mark.parametrize(
    ("volts", "degrees"),
    [(10.5, -10.0), *(pytest.param(*case, marks=pytest.mark.nightly) for case in STICKS)],
)
@on_virtual_time
async def test_a_turn_ends_at_its_goal_where_the_wheels_stick(
    tmp_path: Path, volts: float, degrees: float
) -> None:
    """A correction lasts until the counts begin: a pulse is over before."""
    async with MoveBench(tmp_path, "x3", 0.06, battery_volts=volts, **STICKING) as bench:
        await bench.ready()
        await asyncio.sleep(0.5)
        turn = await drive(bench, Move(kind="turn", angle_rad=math.radians(degrees)))
        assert math.degrees(turn.turned_rad) == pytest.approx(degrees, abs=1.0)
        assert turn.ended.message.endswith(f"to the {'left' if degrees > 0.0 else 'right'}.")


@pytest.mark.nightly
@pytest.mark.parametrize("volts", [10.5, 12.0])
@on_virtual_time
async def test_a_straight_that_sticking_wheels_bend_ends_with_its_heading(
    tmp_path: Path, volts: float
) -> None:
    async with MoveBench(tmp_path, "x3", 0.06, battery_volts=volts, **STICKING) as bench:
        await bench.ready()
        await asyncio.sleep(0.5)
        straight = await drive(bench, Move(kind="straight", distance_m=0.4))
        assert straight.ahead_m == pytest.approx(0.4, abs=0.01)
        assert abs(straight.turned_rad) < math.radians(3.5)


@pytest.mark.nightly
@on_virtual_time
async def test_a_square_of_eight_moves_ends_where_it_began(tmp_path: Path) -> None:
    async with MoveBench(tmp_path) as bench:
        await bench.ready()
        side = [Move(kind="straight", distance_m=0.5), Move(kind="turn", angle_rad=math.pi / 2.0)]
        square = await drive(bench, *side * 4)
        assert math.hypot(square.ahead_m, square.left_m) < 0.003
        assert square.turned_rad == pytest.approx(2.0 * math.pi, abs=math.radians(0.4))


@pytest.mark.nightly
@on_virtual_time
async def test_a_goal_is_neared_without_a_stop_at_its_corners(tmp_path: Path) -> None:
    """The turn towards it and the way to it hand on what they leave to the next leg."""
    async with MoveBench(tmp_path) as bench:
        await bench.ready()
        await drive(bench, Move(kind="straight", distance_m=1.0))
        there = await drive(bench, Move(kind="go_to", x=0.6, y=0.6, theta=0.0))
        assert math.hypot(there.end.x - 0.6, there.end.y - 0.6) < 0.005
        assert there.time_s <= there.ideal_s + 3.0 * 0.1 + 0.3


@pytest.mark.parametrize("lag_s", [0.1, pytest.param(0.3, marks=pytest.mark.nightly)])
@on_virtual_time
async def test_what_is_passed_early_is_corrected_before_a_goal_counts_as_reached(
    tmp_path: Path, lag_s: float
) -> None:
    """A turn of a degree cannot correct where the way ended, nor a way of 7 mm be left out."""
    async with MoveBench(tmp_path, lag_s=lag_s) as bench:
        await bench.ready()
        for way, turn in ((0.3, 0.5), (0.5, 1.0), (0.007, 57.0)):
            pose = bench.heard.estimates[-1].pose
            x = pose.x + way * math.cos(pose.theta)
            y = pose.y + way * math.sin(pose.theta)
            theta = pose.theta + math.radians(turn)
            await drive(bench, Move(kind="go_to", x=x, y=y, theta=theta))
            pose = bench.heard.estimates[-1].pose
            assert math.hypot(pose.x - x, pose.y - y) < 0.004


@pytest.mark.nightly
@on_virtual_time
async def test_short_ways_to_the_side_are_not_blocked(tmp_path: Path) -> None:
    """A turn there and one back end at the first heading, 30 mm to the side."""
    async with MoveBench(tmp_path) as bench:
        await bench.ready()
        for side in (0.03, -0.03, 0.05, -0.05):
            pose = bench.heard.estimates[-1].pose
            there = await drive(bench, Move(kind="go_to", x=pose.x, y=pose.y + side, theta=0.0))
            assert math.hypot(there.end.x - pose.x, there.end.y - pose.y - side) < 0.005


@on_virtual_time
async def test_mecanum_drives_sideways_and_turns_on_its_way(tmp_path: Path) -> None:
    async with MoveBench(tmp_path, "mecanum") as bench:
        await bench.ready()
        aside = await drive(bench, Move(kind="straight", left_m=0.4))
        assert (aside.ahead_m, aside.left_m) == pytest.approx((0.0, 0.4), abs=0.002)
        there = await drive(bench, Move(kind="go_to", x=0.5, y=-0.3, theta=2.0))
        assert math.hypot(there.end.x - 0.5, there.end.y + 0.3) < 0.005
        assert there.end.theta == pytest.approx(2.0, abs=math.radians(0.5))


@on_virtual_time
async def test_a_base_that_is_held_is_blocked(tmp_path: Path) -> None:
    async with MoveBench(tmp_path) as bench:
        await bench.ready()
        for motor in bench.robot.plant.motors:
            motor.faults = MotorFaults(stalled=True)
        driven = await bench.move([Move(kind="straight", distance_m=1.0)])
        assert driven.ended.reason == "blocked"
        assert "obstacle" in driven.ended.message


@on_virtual_time
async def test_a_car_drives_arcs_goals_and_paths_and_refuses_a_turn_in_place(
    tmp_path: Path,
) -> None:
    """Its wheels do not see how late the steering is: it ends where its pose has the goal."""
    async with MoveBench(tmp_path, "r2") as bench:
        await bench.ready()
        await asyncio.sleep(0.5)
        arc = await drive(bench, Move(kind="arc", radius_m=0.6, angle_rad=1.0))
        assert arc.turned_rad == pytest.approx(1.0, abs=0.03)
        await drive(bench, Move(kind="go_to", x=1.5, y=0.0, theta=0.0))
        pose = bench.heard.estimates[-1].pose
        assert math.hypot(pose.x - 1.5, pose.y) < 0.005
        points = tuple((1.5 + 0.05 * i, 0.2 - 0.2 * math.cos(0.1 * i)) for i in range(1, 25))
        followed = await drive(bench, Move(kind="follow", points=points))
        pose = bench.heard.estimates[-1].pose
        assert math.dist((pose.x, pose.y), points[-1]) < 0.005
        # The third of them: each bend adds to what the pose does not know, and so does a rear
        # wheel that begins later than the other. Equal wheels end within 0.06 m.
        assert math.dist((followed.end.x, followed.end.y), points[-1]) < 0.12
        with pytest.raises(MoveRefused, match="does not turn in place"):
            await bench.move([Move(kind="turn", angle_rad=1.0)])


@pytest.mark.nightly
@on_virtual_time
async def test_with_slip_the_end_is_as_good_as_the_pose(tmp_path: Path) -> None:
    async with MoveBench(tmp_path, "4wd") as bench:
        await bench.ready()
        bench.slip(0.0, 0.05, seed=1)
        driven = await drive(bench, Move(kind="straight", distance_m=1.0))
        pose = bench.heard.estimates[-1].pose
        assert math.hypot(pose.x - 1.0, pose.y) < 0.002
        assert 0.01 < math.hypot(driven.end.x - 1.0, driven.end.y) < 0.08


@pytest.mark.parametrize(
    ("least", "most"), [pytest.param(0.0, 0.2, marks=pytest.mark.nightly), (0.8, 0.9)]
)
@on_virtual_time
async def test_wheels_that_spin_while_the_gyro_stands_end_it_and_little_slip_does_not(
    tmp_path: Path, least: float, most: float
) -> None:
    async with MoveBench(tmp_path, "x3") as bench:
        await bench.ready()
        await asyncio.sleep(0.5)
        bench.slip(least, most, seed=1)
        driven = await bench.move([Move(kind="turn", angle_rad=3.0)])
        assert driven.ended.reason == ("slipping" if least else "reached")
        assert not least or driven.time_s < 1.0


# Without a robot.


def mover(*moves: Move) -> Mover:
    return Mover(moves, Pose2d(), BASE, LagModel())


@pytest.mark.parametrize(("apart_s", "late"), [(0.02, ""), (0.15, "Poses came up to 0.15 s apart")])
def test_a_base_that_stands_short_of_its_goal_is_said_to_and_whether_poses_came_late(
    apart_s: float, late: str
) -> None:
    short = mover(Move(kind="straight", distance_m=0.5))
    x, vx, now_ns = 0.0, 0.0, 0
    while short.ended is None:
        lands = short._leg is not None and short._leg.lands
        now_ns += round(1e9 * (apart_s if lands else 0.02))
        # The last millimetres it does not drive.
        x = 0.494 if lands else x + 0.02 * vx
        twist = short.step(Pose2d(x=x, y=0.0, theta=0.0), now_ns)
        vx = vx if twist is None else twist.vx
    assert short.ended.reason == "short"
    assert short.ended.message.startswith("The base stands 6.0 mm from its goal")
    assert ("apart" in short.ended.message) == bool(late)
    assert late in short.ended.message


@pytest.mark.parametrize(("beside", "reason"), [(0.009, "reached"), (0.02, "short")])
def test_a_base_beside_its_goal_is_said_to_be_there(beside: float, reason: str) -> None:
    short = mover(Move(kind="follow", points=((0.0, 0.0), (0.25, 0.0), (0.5, 0.0))))
    x, vx, now_ns = 0.0, 0.0, 0
    while short.ended is None:
        now_ns += 20_000_000
        x += 0.02 * vx
        twist = short.step(Pose2d(x=x, y=beside * min(1.0, x / 0.2)), now_ns)
        vx = vx if twist is None else twist.vx
    assert short.ended.reason == reason
    if reason == "short":
        assert short.ended.message.startswith("The base stands 20.0 mm from its goal, beside")


def test_it_commands_at_fifty_hertz_however_often_poses_come() -> None:
    made = mover(Move(kind="straight", distance_m=1.0))
    answers = [made.step(Pose2d(), step * 5_000_000) for step in range(40)]
    assert sum(answer is not None for answer in answers) == 10


def test_moves_that_change_nothing_are_reached_at_once() -> None:
    made = mover(Move(kind="turn", angle_rad=0.0))
    assert made.step(Pose2d(), 0) is None
    assert made.ended is not None
    assert made.ended.reason == "reached"
    assert made.progress.done == 1.0


def test_the_first_end_counts_and_nothing_is_commanded_after_it() -> None:
    made = mover(Move(kind="straight", distance_m=1.0))
    assert made.step(Pose2d(), 0) is not None
    made.end("cancelled", "You cancelled it.")
    made.end("estop", "Too late.")
    assert made.step(Pose2d(), STEP_NS) is None
    assert made.ended is not None
    assert made.ended.reason == "cancelled"


def test_paused_it_stands_and_resumed_it_goes_on() -> None:
    made = mover(Move(kind="straight", distance_m=1.0))
    at_m = 0.0
    twists: list[Twist2d] = []
    for step in range(160):
        if step == 60:
            made.pause()
        if step == 120:
            made.resume()
        twist = made.step(Pose2d(x=at_m), step * STEP_NS)
        if twist is not None:
            twists.append(twist)
            at_m += twist.vx * 0.02
    assert twists[59].vx > 0.2
    assert twists[118].vx == 0.0
    assert not made.paused
    assert twists[-1].vx > 0.1


def test_progress_counts_what_is_left_of_all_moves() -> None:
    made = mover(Move(kind="straight", distance_m=1.0), Move(kind="turn", angle_rad=-2.0))
    made.step(Pose2d(), 0)
    begun = made.progress
    assert (begun.index, begun.kind) == (0, "straight")
    assert (begun.left_m, begun.left_rad) == pytest.approx((1.0, 2.0))
    assert begun.left_s == pytest.approx(made.time_s)
    made.step(Pose2d(x=0.05), STEP_NS)
    assert made.progress.left_m == pytest.approx(0.95)
    assert 0.0 < made.progress.done < 0.1
