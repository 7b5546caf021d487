"""``yahboomd send``: drives for a number of seconds, from a script."""

from __future__ import annotations

import argparse
import asyncio
import os
import signal
import sys
from typing import TYPE_CHECKING

from yahboomd.cli.attended import add_robot_options, attend
from yahboomd.cli.shared_options import (
    add_source_option,
    number,
    read_config,
    source_of,
    take_negative_numbers,
)
from yahboomd.core.errors import NoDaemon
from yahboomd.core.model import FASTEST_M_S, FASTEST_RAD_S

if TYPE_CHECKING:
    from yahboomd.client import AsyncRobot, Samples, StatusSample
    from yahboomd.tools.robot.obedience import Obedience

STATUS_WITHIN_S = 3.0
"""A status comes twice a second; without one for this time the daemon does not run."""

DESCRIPTION = """\
Drive for a number of seconds. The command is repeated twenty times a second and ends with zeros,
however it ends: when its time is over, at Ctrl-C, SIGTERM, SIGHUP or Ctrl-Z, and when the reader of
its output leaves, as at the end of an SSH connection. Should this process die, the daemon stops the
robot within half a second. If the robot does not obey, it prints the reason; otherwise it
prints nothing.
"""

EPILOG = """\
examples:
  yahboomd send --vx 0.2 --for 2                  forward, for two seconds
  yahboomd send --vx 0.2 --wz 0.5 --for 2         a curve to the left
  yahboomd send --wz -1 --for 1.57 && yahboomd pose

exit status:
  0    the robot obeyed to the end
  1    it did not, or not to the end: stopped for an emergency, a fault, no board, another source in
       control, or this process did not run; the message names it. The robot was stopped
  2    the arguments make no sense, such as no --for
  69   no daemon is there, or it was lost
  78   a mistake in the configuration
  130  Ctrl-C; other signals end with 128 and their number. The robot was stopped
  141  the reader of the output has left. The robot was stopped
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    speed = number("a velocity up to 100 m/s", lambda value: abs(value) <= FASTEST_M_S)
    turn = number("a velocity up to 1000 rad/s", lambda value: abs(value) <= FASTEST_RAD_S)
    for flag, unit, read, words in (
        ("--vx", "M_PER_S", speed, "forward, in m/s"),
        ("--vy", "M_PER_S", speed, "to the left, in m/s; for mecanum wheels"),
        ("--wz", "RAD_PER_S", turn, "counter-clockwise, in rad/s"),
    ):
        parser.add_argument(flag, metavar=unit, type=read, help=words)
    parser.add_argument(
        "--for",
        metavar="SECONDS",
        dest="for_s",
        type=number("a number of seconds above 0, up to 3600", lambda value: 0.0 < value <= 3600.0),
        required=True,
        help="how long, from above 0 to 3600 seconds",
    )
    add_source_option(parser, "cmd_vel")
    add_robot_options(parser)
    take_negative_numbers(parser)


def run(args: argparse.Namespace) -> int:
    """Drive."""
    if args.vx is None and args.vy is None and args.wz is None:
        print(
            "yahboomd send: error: give a velocity: --vx, --vy or --wz. 0 holds the robot.",
            file=sys.stderr,
        )
        return 2
    from yahboomd.core.daemon.process import deadly

    source = source_of(args, read_config(args).config, "cmd_vel")
    # A signal to suspend ends it: while suspended it would repeat nothing, and once continued it
    # would drive on.
    ending = (*deadly(), signal.SIGTSTP)
    return attend(args, lambda robot: _drive(robot, args, source), source=source, signals=ending)


async def _drive(robot: AsyncRobot, args: argparse.Namespace, source: str) -> int:
    from yahboomd.client import Refused, StatusSample
    from yahboomd.tools.robot.obedience import Obedience

    before = await robot.get(StatusSample)
    if before is None:
        raise Refused("The daemon has published no status yet: nothing was sent.")
    statuses = robot.samples(StatusSample)
    if Obedience(source, before).trouble_before():
        # That status may be older than the release of an emergency stop.
        before = await _next_status(statuses) or before
    obedience = Obedience(source, before)
    if trouble := obedience.trouble_before():
        raise Refused(f"Nothing was sent. {trouble}")
    robot.drive(args.vx or 0.0, args.wz or 0.0, vy=args.vy or 0.0, for_s=args.for_s)
    lasted, trouble = await _watched(robot, obedience, statuses)
    if not trouble and lasted:
        # One more status, which counts the last commands too.
        last = await _next_status(statuses)
        if last is None:
            raise _lost()
        trouble = obedience.trouble(last) or obedience.trouble_after()
    if trouble:
        raise Refused(f"The robot does not obey. {trouble}")
    if not lasted:
        raise _lost()
    for words in obedience.warnings:
        print(f"yahboomd: {words}", file=sys.stderr)
    return os.EX_OK


async def _watched(
    robot: AsyncRobot, obedience: Obedience, statuses: Samples[StatusSample]
) -> tuple[bool, str]:
    """Watch until the command ends; returns whether it lasted, and why the robot disobeys."""
    driven = asyncio.create_task(robot.finished())
    watched = asyncio.create_task(_trouble(obedience, statuses))
    try:
        await asyncio.wait((driven, watched), return_when=asyncio.FIRST_COMPLETED)
        if watched.done():
            robot.stop()
        return await driven, watched.result() if watched.done() else ""
    finally:
        driven.cancel()
        watched.cancel()
        await asyncio.gather(driven, watched, return_exceptions=True)


async def _trouble(obedience: Obedience, statuses: Samples[StatusSample]) -> str:
    while (status := await _next_status(statuses)) is not None:
        if trouble := obedience.trouble(status):
            return trouble
    raise _lost()


async def _next_status(statuses: Samples[StatusSample]) -> StatusSample | None:
    try:
        async with asyncio.timeout(STATUS_WITHIN_S):
            return await anext(statuses, None)
    except TimeoutError:
        return None


def _lost() -> NoDaemon:
    return NoDaemon(
        "The daemon was lost, or does not run any more. One that runs stops the robot by itself.",
        remedy="Look at the robot. If it moves, run `yahboomd stop`.",
    )
