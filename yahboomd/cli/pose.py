"""``yahboomd pose``: prints the pose, or sets it."""

from __future__ import annotations

import argparse
import math
import os
import sys
from typing import TYPE_CHECKING

from yahboomd.cli.attended import add_robot_options, attend
from yahboomd.cli.shared_options import number, take_negative_numbers

if TYPE_CHECKING:
    from yahboomd.client import AsyncRobot, PoseSample

OLD = 1
"""The exit status if the pose is old."""

OLD_S = 1.0

_number = number("a number")

DESCRIPTION = """\
Print the robot's pose by odometry, as three numbers: x and y in metres, the heading theta in
radians (counter-clockwise, not wrapped). Or have odometry go on from another pose; the robot does
not move. The first pose printed within 0.1 s after that may still be the one before.
"""

EPILOG = """\
examples:
  yahboomd pose
  read x y theta < <(yahboomd pose)             in bash
  yahboomd pose --json | jq .covariance         the whole sample, as it is on the bus
  yahboomd pose --reset
  yahboomd pose --to 1.2 -0.5 1.5708
  yahboomd pose --to 1.2 -0.5 90deg

exit status:
  0    done
  1    there is no pose yet, or it is older than a second (it is printed all the same, and why);
       with --reset and --to: the daemon refuses
  69   no daemon is there
  78   a mistake in the configuration
"""


def angle(text: str) -> float:
    """Read an angle: radians, or degrees as in 90deg.

    Raises:
        argparse.ArgumentTypeError: It is not a number.
    """
    digits = text.removesuffix("deg")
    return math.radians(_number(digits)) if digits != text else _number(text)


def heading(text: str) -> float:
    """Read a heading in radians, or with ``deg`` behind it in degrees.

    Raises:
        argparse.ArgumentTypeError: It is not a number, or more radians than a turn: that is
            usually meant in degrees.
    """
    theta = angle(text)
    if abs(theta) > math.tau and not text.endswith("deg"):
        turns = f"{text} is {theta / math.tau:.3g} turns. For degrees write {text}deg."
        raise argparse.ArgumentTypeError(f"THETA is in radians, and {turns}")
    return theta


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        "--json", action="store_true", help="print the sample as JSON, as it is on the bus"
    )
    what.add_argument("--reset", action="store_true", help="make the pose zero")
    what.add_argument(
        "--to",
        nargs=3,
        metavar=("X", "Y", "THETA"),
        dest="pose",
        help="go on from this pose, in metres and radians, or degrees as in 90deg",
    )
    add_robot_options(parser)
    take_negative_numbers(parser)


def run(args: argparse.Namespace) -> int:
    """Print it, or change it."""
    if args.pose:
        x, y, theta = args.pose
        try:
            args.pose = (_number(x), _number(y), heading(theta))
        except argparse.ArgumentTypeError as error:
            print(f"yahboomd pose: error: argument --to: {error}", file=sys.stderr)
            return 2

    async def work(robot: AsyncRobot) -> int:
        if args.reset:
            print(await robot.reset_odometry())
        elif args.pose:
            print(await robot.set_pose(*args.pose))
        else:
            return await _print(robot, as_json=args.json)
        return os.EX_OK

    return attend(args, work)


async def _print(robot: AsyncRobot, *, as_json: bool) -> int:
    from yahboomd.client import PoseSample, StatusSample
    from yahboomd.core.bus.keys import POSE, STATUS
    from yahboomd.tools.robot.on_bus import newest, one_line
    from yahboomd.tools.terminal.words import duration

    payload, pose = await newest(robot, POSE, PoseSample)
    _, status = await newest(robot, STATUS, StatusSample)
    print(one_line(payload) if as_json else line(pose), flush=True)
    # Compare stamps of the robot's clock, because this machine's clock may differ.
    age_s = (status.stamp_ns - pose.stamp_ns) / 1e9
    if age_s <= OLD_S:
        return os.EX_OK
    print(f"yahboomd: This pose is {duration(age_s)} old. {status.why}", file=sys.stderr)
    return OLD


def line(pose: PoseSample) -> str:
    """x, y and theta with six digits, without a negative zero."""
    return " ".join(f"{round(each, 6) + 0.0:.6f}" for each in (pose.x, pose.y, pose.theta))
