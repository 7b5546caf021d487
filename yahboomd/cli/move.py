"""``yahboomd move``: drives straight, turns, goes to a place or follows a path, to its end."""

from __future__ import annotations

import argparse
import math
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from yahboomd.cli.attended import add_robot_options, attend
from yahboomd.cli.pose import angle, heading
from yahboomd.cli.shared_options import number, take_negative_numbers
from yahboomd.tools.robot.path_file import read_points, summary

if TYPE_CHECKING:
    from yahboomd.client import AsyncRobot, Move, MoveSample

BAR = 30
"""Characters of the progress bar."""

_number = number("a number")
_above_zero = number("a number above 0", lambda value: value > 0.0)

DESCRIPTION = """\
Drive a metre, turn by a quarter, go to a place, follow a path. `yahboomd moves` drives it, with
feedback on the pose all the way; this command stays there until the end and shows how far it is. If
it ends by Ctrl-C, a signal, or with its terminal, the robot stops. If the robot does not reach the
goal, it prints why.
"""

EPILOG = """\
examples:
  yahboomd move straight 1                  a metre ahead; -1: backward
  yahboomd move straight 0 --left 0.5       half a metre to the left, on mecanum wheels
  yahboomd move turn 90deg                  to the left; -90deg: to the right
  yahboomd move arc 0.5 180deg              half a circle to the left, 0.5 m in radius
  yahboomd move goto 2 1 90deg              to x 2 m, y 1 m, and face 90 degrees there
  yahboomd move path way.csv --speed 0.2    a line for each point: x,y or x,y,theta, in m and rad

exit status:
  0    the goal is reached
  1    it is not: refused, taken over, blocked, stopped; the message names it. The robot stands
  2    the arguments make no sense
  69   no daemon or no `yahboomd moves` is there
  78   a mistake in the configuration
  130  Ctrl-C; other signals end with 128 and their number. The robot was stopped
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the moves."""
    kinds = parser.add_subparsers(dest="kind", metavar="MOVE", required=True)

    def kind(name: str, words: str) -> argparse.ArgumentParser:
        return kinds.add_parser(name, help=words, description=f"{words.capitalize()}.")

    straight = kind("straight", "drive straight")
    straight.add_argument("distance", metavar="METRES", type=_number, help="negative: backward")
    straight.add_argument(
        "--left", metavar="METRES", type=_number, default=0.0, help="to the left, on mecanum wheels"
    )
    turn = kind("turn", "turn in place")
    turn.add_argument("angle", metavar="ANGLE", type=angle, help="radians, or degrees as in 90deg")
    arc = kind("arc", "drive along an arc")
    arc.add_argument("radius", metavar="RADIUS", type=_above_zero, help="metres")
    arc.add_argument("angle", metavar="ANGLE", type=angle, help="positive: to the left")
    goto = kind("goto", "go to a place of the odometry frame")
    goto.add_argument("x", metavar="X", type=_number, help="metres")
    goto.add_argument("y", metavar="Y", type=_number, help="metres")
    goto.add_argument(
        "heading", metavar="HEADING", type=heading, nargs="?", help="there; radians, or 90deg"
    )
    path = kind("path", "follow a path")
    path.add_argument(
        "file",
        metavar="FILE.csv",
        type=Path,
        help="x,y or x,y,theta in each line; no other columns",
    )
    path.add_argument(
        "--corner",
        metavar="METRES",
        type=number("0 or more", lambda value: value >= 0.0),
        help="how far corners may be cut (default: 0.01)",
    )
    for each in (arc, goto, path):
        each.add_argument(
            "--backward",
            action="store_true",
            help="drive backward; goto and path: if that needs less turning",
        )
    for each in (straight, turn, arc, goto, path):
        each.add_argument(
            "--speed", metavar="M_PER_S", type=_above_zero, help="the most (default: 0.3)"
        )
        each.add_argument(
            "--turn-speed", metavar="RAD_PER_S", type=_above_zero, help="the most (default: 1.5)"
        )
        add_robot_options(each)
        take_negative_numbers(each)


def run(args: argparse.Namespace) -> int:
    """Drive it."""
    move = _move(args)
    if move.points:
        print(summary(move.points), flush=True)
    return attend(args, lambda robot: _drive(robot, move))


def _move(args: argparse.Namespace) -> Move:
    from yahboomd.client import Move

    limits = {"speed_m_s": args.speed, "turn_rad_s": args.turn_speed}
    if args.kind == "straight":
        return Move(kind="straight", distance_m=args.distance, left_m=args.left, **limits)
    if args.kind == "turn":
        return Move(kind="turn", angle_rad=args.angle, **limits)
    if args.kind == "arc":
        return Move(
            kind="arc",
            radius_m=args.radius,
            angle_rad=args.angle,
            backward=args.backward,
            **limits,
        )
    if args.kind == "goto":
        return Move(
            kind="go_to",
            x=args.x,
            y=args.y,
            theta=args.heading,
            backward=args.backward,
            **limits,
        )
    return Move(
        kind="follow",
        points=read_points(args.file),
        backward=args.backward,
        corner_m=args.corner,
        **limits,
    )


async def _drive(robot: AsyncRobot, move: Move) -> int:
    on_terminal = sys.stderr.isatty()
    async with robot.moves(move) as run:
        async for progress in run:
            if on_terminal:
                print(f"\r{bar(progress)}", end="", file=sys.stderr, flush=True)
        if on_terminal:
            print(file=sys.stderr)
        print((await run.finished()).message)
    return os.EX_OK


def bar(progress: MoveSample) -> str:
    """The progress as a line: a bar, the remaining way and turns, the remaining time."""
    full = round(BAR * progress.done)
    left = f"{progress.left_m:6.2f} m" if progress.left_m else ""
    turns = f"{math.degrees(progress.left_rad):6.0f}°" if progress.left_rad else ""
    words = "paused" if progress.state == "paused" else f"{progress.left_s:5.1f} s"
    return f"[{'#' * full}{'.' * (BAR - full)}] {left:>8} {turns:>7} {words:>7} "
