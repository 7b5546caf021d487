"""``yahboomd drive``: drives the robot with the keyboard or a gamepad."""

from __future__ import annotations

import argparse
import asyncio
import os
import sys
from typing import TYPE_CHECKING

from yahboomd.cli.shared_options import (
    add_bus_options,
    add_config_options,
    add_source_option,
    daemon_options,
    number,
    read_config,
    source_of,
)
from yahboomd.core.model import FASTEST_M_S, FASTEST_RAD_S

if TYPE_CHECKING:
    from yahboomd.core.bus.options import BusOptions
    from yahboomd.tools.screens.teleop import Teleop

USAGE = 2
"""The exit status of argparse when the arguments make no sense."""

DESCRIPTION = """\
Drive the robot with the keyboard, through a running daemon. Hold a key to drive; when you let go,
the robot stops. (A terminal does not report when a key is let go: after the first press that
takes up to 0.7 s.) The screen shows the robot's state, and the reason if it stands. With --gamepad
a pad drives as well, while one of its shoulder buttons is held.
"""

EPILOG = """\
keys:
  w s a d, the arrows    forward, backward, turn left, turn right
  u i o  j l  m , .      the same, and arcs between; J and L (shift) go sideways, on mecanum wheels
  space, any other key   stop; held, it keeps sources of a lower priority from driving
  + -                    faster, slower
  e                      emergency stop: the robot stands until it is released
  r                      release the emergency stop, or clear a fault
  q, Ctrl-C              quit; the robot stops

gamepad, with --gamepad:
  shoulder (LB or RB)    hold it to drive; let go, and the robot stops
  left stick             forward and backward, turn; the right one goes sideways, on mecanum wheels
  d-pad up, down         faster, slower
  east (B, circle)       emergency stop
  start                  release the emergency stop, or clear a fault
  A pad that goes stops the robot, and is found again when it is back. One by radio whose link is
  lost keeps its last state until the system notices, with Bluetooth for seconds: use a cable where
  that matters.

examples:
  yahboomd drive                                  the daemon on this machine
  yahboomd drive --gamepad                        the first gamepad of this machine
  yahboomd drive --gamepad /dev/input/event5
  yahboomd drive --linear 0.2 --connect tcp/192.168.1.5:7447

exit status:
  0    you quit, or its terminal went; the robot was stopped
  2    it has no terminal
  69   the bus can never be reached like this
  78   a mistake in the configuration
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    speed = number("a speed above 0, up to 100 m/s", lambda value: 0.0 < value <= FASTEST_M_S)
    turn = number("a speed above 0, up to 1000 rad/s", lambda value: 0.0 < value <= FASTEST_RAD_S)
    parser.add_argument(
        "--linear",
        metavar="M_PER_S",
        type=speed,
        default=0.3,
        help="speed to begin with, in m/s (default: %(default)s)",
    )
    parser.add_argument(
        "--angular",
        metavar="RAD_PER_S",
        type=turn,
        default=1.0,
        help="turning speed to begin with, in rad/s (default: %(default)s)",
    )
    parser.add_argument(
        "--gamepad",
        metavar="DEVICE",
        nargs="?",
        const="",
        help="drive by a gamepad, too: by this input device, or by the first one that is there",
    )
    add_source_option(parser, "cmd_vel/teleop")
    add_bus_options(parser)
    add_config_options(parser)


def run(args: argparse.Namespace) -> int:
    """Drive until a person or a signal ends it."""
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        print(
            "yahboomd: drive needs a terminal: its keys are read from one, and it draws on it. "
            "Programs publish on cmd_vel instead.",
            file=sys.stderr,
        )
        return USAGE
    # Imported first, so that a missing package is reported before anything is opened.
    import rich  # noqa: F401

    config = read_config(args).config
    from yahboomd.tools.screens.teleop import Teleop

    source = source_of(args, config, "cmd_vel/teleop")
    options = daemon_options(args, config)
    teleop = Teleop(linear_m_s=args.linear, angular_rad_s=args.angular)
    asyncio.run(_run(options, teleop, source, args.gamepad))
    return os.EX_OK


async def _run(options: BusOptions, teleop: Teleop, source: str, gamepad: str | None) -> None:
    from yahboomd.core.clock import SystemClock
    from yahboomd.tools.screens.driver import Driver
    from yahboomd.tools.screens.feed import Feed

    clock = SystemClock()
    async with Feed(options, clock, source=source, label="yahboomd drive") as feed:
        await Driver(feed, teleop, clock, source, gamepad).run()
