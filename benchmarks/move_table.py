"""Measures moves against the truth of simulated robots: ``make moves``.

Random straights, turns, goals and paths, on bases of every geometry, with motors whose time
constant is 0.05 to 0.3 s behind the speed loop of the simulated board, without slip. Beside them a
plain proportional loop as one writes it: twenty times a second a speed in proportion to what is
left, until little is left. Each base makes eight moves; the first has not learned anything yet.
"""

from __future__ import annotations

import argparse
import asyncio
import math
import tempfile
from concurrent.futures import ProcessPoolExecutor
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import NamedTuple

from floor_options import floor_options
from move_bench import TRACK_M, Drive, MoveBench

from benchmarks.results import quantile
from yahboomd.client.move_messages import Move
from yahboomd.core.model import Pose2d
from yahboomd.moves.motion.move_course import wrapped
from yahboomd.moves.motion.mover import MoveEnd
from yahboomd.simulation.virtual_time import run as run_virtual

PRESETS = ("2wd", "4wd", "mecanum")
KINDS = ("straight", "turn", "go_to", "follow")
EACH = 8
COUNT_M = 2.0 * math.pi * 0.0335 / 1320.0
SPARE_S = 0.3
SPEED_M_S, TURN_RAD_S = 0.3, 1.5


class Result(NamedTuple):
    """One move.

    Attributes:
        kind: What it was.
        lag_s: The time constant of the motors.
        place_m: How far from its goal it ended; of a turn, the way it drifted.
        heading_rad: The error of the heading, where one was asked for.
        over_s: The time beyond the ideal profile's.
        past_counts: How far it went past its end, in counts of a wheel.
        beside_m: On a path: the largest distance to it.
        reached: Whether it ended so.
    """

    kind: str
    lag_s: float
    place_m: float
    heading_rad: float
    over_s: float
    past_counts: float
    beside_m: float
    reached: bool


def wave(chance: Random, begin: Pose2d) -> tuple[tuple[float, float], ...]:
    """A smooth path of 20 mm steps that begins in the direction of the base."""
    bend, theta = 0.0, begin.theta
    x, y = begin.x, begin.y
    points = []
    for _ in range(60):
        bend += chance.uniform(-0.35, 0.35)
        bend = max(-3.0, min(3.0, bend))
        theta += bend * 0.02
        x, y = x + 0.02 * math.cos(theta), y + 0.02 * math.sin(theta)
        points.append((x, y))
    return tuple(points)


def chosen(kind: str, chance: Random, pose: Pose2d) -> Move:
    """A random move of this kind."""
    if kind == "straight":
        return Move(kind="straight", distance_m=chance.choice((1, -1)) * chance.uniform(0.05, 1.0))
    if kind == "turn":
        return Move(kind="turn", angle_rad=chance.choice((1, -1)) * chance.uniform(0.2, math.pi))
    if kind == "go_to":
        return Move(
            kind="go_to",
            x=pose.x + chance.uniform(-0.8, 0.8),
            y=pose.y + chance.uniform(-0.8, 0.8),
            theta=chance.uniform(-math.pi, math.pi),
        )
    return Move(kind="follow", points=wave(chance, pose))


def beside(path: list[Pose2d], points: tuple[tuple[float, ...], ...], begin: Pose2d) -> float:
    """The largest distance of a way from a polyline."""
    line = [(begin.x, begin.y), *((p[0], p[1]) for p in points)]

    def off(pose: Pose2d) -> float:
        least = math.inf
        for (ax, ay), (bx, by) in pairwise(line):
            length = math.hypot(bx - ax, by - ay)
            along = ((pose.x - ax) * (bx - ax) + (pose.y - ay) * (by - ay)) / length**2
            along = max(0.0, min(1.0, along))
            least = min(
                least,
                math.hypot(pose.x - ax - along * (bx - ax), pose.y - ay - along * (by - ay)),
            )
        return least

    return max(off(pose) for pose in path)


def judged(move: Move, lag_s: float, drive: Drive, expected: Pose2d) -> Result:
    """The errors of a drive, by its true end and the true pose that was asked for."""
    past = max(0.0, drive.past)
    counts = past * TRACK_M / 2.0 / COUNT_M if move.kind == "turn" else past / COUNT_M
    has_heading = move.kind in {"turn", "go_to"}
    if move.kind == "straight":
        place = abs(drive.ahead_m - move.distance_m)
    else:
        place = math.hypot(drive.end.x - expected.x, drive.end.y - expected.y)
    return Result(
        kind=move.kind,
        lag_s=lag_s,
        place_m=place,
        heading_rad=abs(wrapped(drive.end.theta - expected.theta)) if has_heading else 0.0,
        over_s=drive.time_s - drive.ideal_s,
        past_counts=counts if move.kind in {"straight", "turn"} else 0.0,
        beside_m=beside(drive.path, move.points, drive.begin) if move.kind == "follow" else 0.0,
        reached=drive.ended.reason == "reached",
    )


def goal_of(move: Move, begin: Pose2d) -> Pose2d:
    """Where a move is to end."""
    if move.kind == "turn":
        return Pose2d(x=begin.x, y=begin.y, theta=begin.theta + move.angle_rad)
    if move.kind == "go_to":
        assert move.x is not None
        assert move.y is not None
        return Pose2d(x=move.x, y=move.y, theta=move.theta or 0.0)
    if move.kind == "follow":
        return Pose2d(x=move.points[-1][0], y=move.points[-1][1])
    return Pose2d(
        x=begin.x + move.distance_m * math.cos(begin.theta),
        y=begin.y + move.distance_m * math.sin(begin.theta),
        theta=begin.theta,
    )


async def robot(preset: str, lag_s: float, kind: str, seed: int, *, plain: bool) -> list[Result]:
    """The moves of one robot."""
    chance = Random(seed)
    results: list[Result] = []
    with tempfile.TemporaryDirectory() as folder:
        async with MoveBench(Path(folder), preset, lag_s, seed=seed, **floor_options()) as bench:
            await bench.ready()
            await asyncio.sleep(0.3)
            for _ in range(EACH):
                move = chosen(kind, chance, bench.heard.estimates[-1].pose)
                goal = goal_of(move, bench.heard.estimates[-1].pose)
                drive = await (by_proportion(bench, move) if plain else bench.move([move]))
                results.append(judged(move, lag_s, drive, goal))
    return results


async def by_proportion(bench: MoveBench, move: Move) -> Drive:
    """The same by a plain loop: turn, drive, turn, each in proportion to what is left."""
    began, began_ns = bench.truth, bench.clock.now_ns()
    path: list[Pose2d] = []
    begin = bench.heard.estimates[-1].pose
    past = -math.inf

    async def tick(vx: float, wz: float) -> Pose2d:
        bench.command(vx, wz)
        await asyncio.sleep(0.05)
        path.append(bench.truth)
        return bench.heard.estimates[-1].pose

    async def turn_to(theta: float, pose: Pose2d) -> Pose2d:
        nonlocal past
        sign = math.copysign(1.0, theta - pose.theta)
        for _ in range(600):
            left = theta - pose.theta
            past = max(past, -sign * left)
            if abs(left) < 0.01:
                break
            pose = await tick(0.0, max(-TURN_RAD_S, min(TURN_RAD_S, 3.0 * left)))
        return pose

    async def drive_to(x: float, y: float, pose: Pose2d, near: float, way: float = 1.0) -> Pose2d:
        nonlocal past
        direction = math.atan2(y - pose.y, x - pose.x)
        for _ in range(600):
            left = math.cos(direction) * (x - pose.x) + math.sin(direction) * (y - pose.y)
            past = max(past, -left)
            if left < near:
                break
            bearing = math.atan2(y - pose.y, x - pose.x) + (math.pi if way < 0.0 else 0.0)
            turn = 3.0 * wrapped(bearing - pose.theta) if left > 0.05 else 0.0
            pose = await tick(
                way * min(SPEED_M_S, 2.0 * max(left, 0.02)), max(-1.5, min(1.5, turn))
            )
        return pose

    goal = goal_of(move, begin)
    pose = begin
    if move.kind == "turn":
        pose = await turn_to(goal.theta, pose)
    elif move.kind == "straight":
        pose = await drive_to(goal.x, goal.y, pose, 0.003, math.copysign(1.0, move.distance_m))
    elif move.kind == "go_to":
        bearing = math.atan2(goal.y - pose.y, goal.x - pose.x)
        pose = await turn_to(pose.theta + wrapped(bearing - pose.theta), pose)
        pose = await drive_to(goal.x, goal.y, pose, 0.003)
        pose = await turn_to(pose.theta + wrapped(goal.theta - pose.theta), pose)
    else:
        for x, y in ((point[0], point[1]) for point in move.points[4:]):
            for _ in range(100):
                if math.hypot(x - pose.x, y - pose.y) < 0.08:
                    break
                turn = 3.0 * wrapped(math.atan2(y - pose.y, x - pose.x) - pose.theta)
                pose = await tick(SPEED_M_S, max(-1.5, min(1.5, turn)))
        pose = await drive_to(goal.x, goal.y, pose, 0.003)
    time_s = (bench.clock.now_ns() - began_ns) / 1e9
    for _ in range(20):
        await tick(0.0, 0.0)
    return Drive(
        ended=MoveEnd(reason="reached", message=""),
        time_s=time_s,
        ideal_s=bench.ideal_s(move, begin),
        begin=began,
        end=bench.truth,
        path=path,
        past=past,
    )


def one(job: tuple[str, float, str, int, bool]) -> list[Result]:
    """The moves of one robot, in a process of its own."""
    preset, lag_s, kind, seed, plain = job
    return run_virtual(robot(preset, lag_s, kind, seed, plain=plain))


def jobs(robots: int, seed: int, *, plain: bool) -> list[tuple[str, float, str, int, bool]]:
    """Robots with random lags, of every geometry and kind of move."""
    chance = Random(seed)
    return [
        (
            PRESETS[number % len(PRESETS)],
            round(chance.uniform(0.05, 0.3), 3),
            KINDS[number % len(KINDS)],
            seed * 1000 + number,
            plain,
        )
        for number in range(robots)
    ]


def table(results: list[Result], plain: list[Result]) -> str:
    """The percentiles of both, as a table in Markdown."""
    heads = (
        *("move", "error: median, 95 %, most", "the loop's"),
        *("over the ideal time: median, 95 %", "the loop's"),
        *("past its end, counts: 95 %", "the loop's"),
    )
    lines = [
        f"| {' | '.join(heads)} |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, kind, value, unit in (
        ("straight", "straight", lambda r: 1000.0 * r.place_m, "mm"),
        ("turn", "turn", lambda r: math.degrees(r.heading_rad), "°"),
        ("go_to, place", "go_to", lambda r: 1000.0 * r.place_m, "mm"),
        ("go_to, heading", "go_to", lambda r: math.degrees(r.heading_rad), "°"),
        ("follow, end", "follow", lambda r: 1000.0 * r.place_m, "mm"),
        ("follow, on the way", "follow", lambda r: 1000.0 * r.beside_m, "mm"),
    ):
        cells = [name]
        for part in (results, plain):
            of = [value(each) for each in part if each.kind == kind] or [math.nan]
            figures = ", ".join(f"{quantile(of, q):.2f}" for q in (0.5, 0.95, 1.0))
            cells.append(f"{figures} {unit}")
        for part in (results, plain):
            of = [each.over_s for each in part if each.kind == kind] or [math.nan]
            cells.append(f"{quantile(of, 0.5):.2f}, {quantile(of, 0.95):.2f} s")
        for part in (results, plain):
            of = [each.past_counts for each in part if each.kind == kind] or [math.nan]
            cells.append(f"{quantile(of, 0.95):.1f}" if kind in {"straight", "turn"} else "")
        lines.append(f"| {' | '.join(cells)} |")
    reached = sum(each.reached for each in results)
    lines.append(f"\n{reached} of {len(results)} moves ended with `reached`.")
    shares = []
    for kind in KINDS:
        in_time = [
            each.over_s <= 3.0 * each.lag_s + SPARE_S for each in results if each.kind == kind
        ]
        shares.append(f"{kind} {100.0 * sum(in_time) / max(1, len(in_time)):.0f} %")
    lines.append(f"Within the ideal time, three lags and {SPARE_S} s: {', '.join(shares)}.")
    return "\n".join(lines)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.move_table", description=__doc__)
    parser.add_argument("--moves", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    robots = max(len(KINDS), args.moves // EACH)
    with ProcessPoolExecutor(2) as pool:
        both = [
            [each for part in pool.map(one, jobs(robots, args.seed, plain=plain)) for each in part]
            for plain in (False, True)
        ]
    print(table(both[0], both[1]))


if __name__ == "__main__":
    main()
