"""``yahboomd events``: prints events as they happen, one on a line."""

from __future__ import annotations

import argparse
import os
import time
from typing import TYPE_CHECKING

from yahboomd.cli.attended import add_robot_options, attend

if TYPE_CHECKING:
    from yahboomd.client import AsyncRobot, EventSample

DESCRIPTION = """\
Wait for an event of the daemon, print it as a line, and end; with --follow, print every one from
now on. Events that happened before are not kept on the bus: `journalctl -u yahboomd` has those of
the service, and `yahboomd status` the state that they led to.
"""

EPILOG = """\
examples:
  yahboomd events --follow
  yahboomd events --follow --json | jq -r 'select(.severity == "error") | .message'
  yahboomd events --json | jq -r .kind            the next event, whenever it comes

Each line is written at once. --follow continues through restarts of the daemon; events are lost
while it is away, or if they come faster than they are read. docs/events.md lists every kind.

exit status:
  0    the event was printed
  69   no daemon is there
  78   a mistake in the configuration
  130  Ctrl-C
  141  the reader of the output has left
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("--follow", action="store_true", help="print every event from now on")
    parser.add_argument("--json", action="store_true", help="print each event as JSON")
    add_robot_options(parser)


def run(args: argparse.Namespace) -> int:
    """Print them."""
    # The loss of the daemon and its return are logged to standard error.
    return attend(
        args, lambda robot: _print(robot, follow=args.follow, as_json=args.json), quiet=False
    )


async def _print(robot: AsyncRobot, *, follow: bool, as_json: bool) -> int:
    import msgspec

    from yahboomd.client import EventSample

    async for event in robot.samples(EventSample):
        print(msgspec.json.encode(event).decode() if as_json else line(event), flush=True)
        if not follow:
            break
    return os.EX_OK


def line(event: EventSample) -> str:
    """An event as a line: its time, severity, kind and message."""
    from yahboomd.core.program import plain

    moment = time.strftime("%Y-%m-%dT%H:%M:%S%z", time.localtime(event.stamp_ns / 1e9))
    return plain(f"{moment} {event.severity} {event.kind}: {event.message}")
