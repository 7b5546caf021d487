"""``yahboomd report``: writes one file for somebody who helps with a problem."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from yahboomd.cli.blackbox import places_asked
from yahboomd.cli.shared_options import (
    add_bus_options,
    add_config_options,
    add_port_option,
    quoted,
    robot_arguments,
)
from yahboomd.core.errors import YahboomdError

DESCRIPTION = """\
Write one ZIP file for somebody who helps with a problem, or to attach to an issue: versions,
machine, configuration, what probe, status and the service's log say, and the newest black box,
which has the robot's last minute. No wheel is turned. Without a daemon the board is asked on its
port, as `yahboomd probe` does.
"""

EPILOG = """\
examples:
  yahboomd report                      yahboomd-report-DATE-TIME.zip, in this folder
  yahboomd report /tmp/stuck.zip
  sudo yahboomd report                 also the service's log and black boxes

It names no passwords, keys or links that let people in. It does name the robot's namespace,
endpoints and ports, and this machine's folders: it is text, read it before you send it. Only you
can read the file.

exit status:
  0    the file is written
  73   it cannot be written
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("path", metavar="FILE", nargs="?", type=Path, help="the file to write")
    add_port_option(parser)
    add_bus_options(parser)
    add_config_options(parser)


def run(args: argparse.Namespace) -> int:
    """Write it."""
    from yahboomd.tools.report.trouble_report import write_report

    path: Path = args.path or Path(time.strftime("yahboomd-report-%Y%m%d-%H%M%S.zip"))
    try:
        write_report(path, lambda command: _options(args, command), _newest_box(args), _say)
    except OSError as error:
        print(
            f"yahboomd: {path} cannot be written: {error.strerror}. Name another file: "
            "yahboomd report FILE.zip",
            file=sys.stderr,
        )
        return os.EX_CANTCREAT
    print(
        f"Wrote {path} ({path.stat().st_size / 1024:.0f} kB). Look through it before you send it."
    )
    return os.EX_OK


def _options(args: argparse.Namespace, command: str) -> Sequence[str]:
    """The options that name the robot, as far as a command has them."""
    port = [] if args.port is None else [f"--set=serial.port={quoted(args.port)}"]
    if command == "config":
        bus = ("--connect=", "--namespace=")
        return [*(each for each in robot_arguments(args) if not each.startswith(bus)), *port]
    return [*robot_arguments(args), *port]


def _newest_box(args: argparse.Namespace) -> tuple[str, bytes] | None:
    """Name and bytes of the box that `blackbox explain` would take; None if there is none."""
    from yahboomd.tools.blackbox.box_places import box_bytes, boxes, choose

    try:
        where, wanted = places_asked(args)
        path = choose(boxes(where), None, wanted)
        return f"{path.stem}.blackbox", box_bytes(path)
    except (YahboomdError, OSError):
        # The part blackbox-explained has the reason.
        return None


def _say(words: str) -> None:
    print(f"  {words}", file=sys.stderr, flush=True)
