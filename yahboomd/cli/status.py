"""``yahboomd status``: prints what a daemon does, and whether it can drive."""

from __future__ import annotations

import argparse
import os
from typing import TYPE_CHECKING

from yahboomd.cli.attended import add_robot_options, attend
from yahboomd.core.messages.native import DRIVABLE

if TYPE_CHECKING:
    from yahboomd.client import AsyncRobot

EXIT_STATUS = {**dict.fromkeys(DRIVABLE, os.EX_OK), "fault": 1, "estopped": 3, "waiting": 4}
UNKNOWN = 1
"""The exit status of each state, and of states that this version does not know."""

DESCRIPTION = """\
Print the daemon's state and the reason, who drives, its board, and counts of everything lost or
refused since it started. The exit status tells whether the robot can drive. The facts are at most
half a second old.
"""

EPILOG = """\
examples:
  yahboomd status
  yahboomd status --json | jq .command.sources    the whole sample, as it is on the bus
  until yahboomd status > /tmp/status; do sleep 1; done
                                                  wait until the robot can drive

Late beats are polls that came late, and control steps that were left out, because the robot's
computer was busy. docs/status.md explains every counter.

exit status:
  0    it can drive: it stands, drives, or slows down by itself
  1    a fault: it refuses motion; the text has the remedy. Also a state of another version of
       yahboomd that this one does not know
  3    the emergency stop is engaged
  4    it waits for its board
  69   no daemon is there
  78   a mistake in the configuration
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        "--json", action="store_true", help="print the sample as JSON, as it is on the bus"
    )
    add_robot_options(parser)


def run(args: argparse.Namespace) -> int:
    """Print it."""
    return attend(args, lambda robot: _print(robot, as_json=args.json))


async def _print(robot: AsyncRobot, *, as_json: bool) -> int:
    from yahboomd.client import StatusSample
    from yahboomd.core.bus.keys import STATUS
    from yahboomd.tools.robot.on_bus import newest, one_line
    from yahboomd.tools.screens.dashboard import Dashboard
    from yahboomd.tools.screens.sentences import status_text

    payload, sample = await newest(robot, STATUS, StatusSample)
    dashboard = Dashboard()
    dashboard.accept(STATUS, payload, 0)
    print(one_line(payload) if as_json else status_text(dashboard.view(0)), flush=True)
    return EXIT_STATUS.get(sample.state, UNKNOWN)
