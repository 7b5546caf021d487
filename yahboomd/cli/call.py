"""``yahboomd call``: calls a service of the daemon."""

from __future__ import annotations

import argparse
import os
import sys
from typing import TYPE_CHECKING

from yahboomd.cli.attended import add_robot_options, attend

if TYPE_CHECKING:
    from yahboomd.client import AsyncRobot

SERVICES = {
    "estop": "engages the emergency stop, and acknowledges that it was sent; "
    "wildcards may stand before the last part of its key",
    "estop/reset": "releases the emergency stop and clears a fault, "
    "unless a source commanded motion within the last second",
    "odometry/reset": "sets the pose to zero",
    "odometry/set_pose": "sets the pose",
    "config": "returns the configuration in effect",
    "board": "returns the board's answers at connecting: firmware and settings",
    "blackbox/save": "saves the black box, at most once a minute",
}
"""Every service by its key below ``yahboomd/``, with its line in the help."""

REFUSED = 1
"""The exit status if a daemon refuses."""

DESCRIPTION = """\
Call a service of the daemon, and print its answer: a line of JSON with success, message and data;
one for each daemon that answers.
"""

EPILOG = (
    "services:\n"
    + "".join(f"  {name:<18}  {line}\n" for name, line in SERVICES.items())
    + """
examples:
  yahboomd call config | jq .data.chassis
  yahboomd call odometry/set_pose '{"x": 1, "y": 2, "theta": 0}'
  yahboomd call estop '{"by": "my script"}'

exit status:
  0    it was done
  1    the daemon refuses; its answer has the reason
  2    the arguments make no sense: no such service, or no JSON
  69   no daemon is there
  78   a mistake in the configuration
"""
)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        "service",
        metavar="SERVICE",
        type=lambda text: text.removeprefix("yahboomd/"),
        choices=tuple(SERVICES),
        help="one of those below; its whole key, such as yahboomd/config, will do",
    )
    parser.add_argument(
        "request",
        metavar="JSON",
        nargs="?",
        type=_request,
        default=b'{"by": "yahboomd call"}',
        help="the request, an object; - reads it from standard input",
    )
    add_robot_options(parser)


def run(args: argparse.Namespace) -> int:
    """Call it."""
    return attend(args, lambda robot: _call(robot, args.service, args.request))


def _request(text: str) -> bytes:
    import msgspec

    payload = sys.stdin.buffer.read() if text == "-" else text.encode(errors="surrogateescape")
    try:
        msgspec.json.decode(payload, type=dict)
    except (ValueError, RecursionError) as error:
        raise argparse.ArgumentTypeError(f"this is no JSON object: {error}") from None
    return payload


async def _call(robot: AsyncRobot, service: str, request: bytes) -> int:
    from yahboomd.client.services import read_answers
    from yahboomd.core.bus import keys
    from yahboomd.core.errors import NoDaemon
    from yahboomd.tools.people.people_keys import NAMED
    from yahboomd.tools.robot.on_bus import one_line

    key = f"yahboomd/{service}"
    if key in NAMED:
        payloads, unproven = await robot.ask_by_name(key, request)
    else:
        payloads, unproven = await robot.ask(key, request), ""
    if not payloads:
        urgent = key == keys.ESTOP
        raise NoDaemon(
            f"The daemon is there, and its service {key} does not answer.",
            remedy="Switch the motors' supply off." if urgent else "Is it busy? Try again.",
        )
    for payload in payloads:
        print(one_line(payload), flush=True)
    if unproven:
        print(unproven, file=sys.stderr)
    return os.EX_OK if read_answers(payloads).success else REFUSED
