"""``yahboomd record``: writes the messages of the bus to MCAP files."""

from __future__ import annotations

import argparse
import asyncio
import datetime
import json
import math
import os
import re
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from yahboomd.cli.attended import add_robot_options, attend
from yahboomd.cli.shared_options import number
from yahboomd.core.errors import Refused
from yahboomd.tools.terminal.input_lines import input_ended

if TYPE_CHECKING:
    from yahboomd.client import AsyncRobot

DESCRIPTION = """\
Record the robot's messages and its commands: poses, twists, wheels, battery, status, events and
commands as JSON with their schemas, and the topics of ROS 2 in CDR with their definitions. The
folder opens in Foxglove and Lichtblick, and `ros2 bag play` plays it. It ends after --for, or at
Ctrl-C; cut off or killed, it can be read up to its last second.
"""

EPILOG = """\
examples:
  yahboomd record                              into a folder named after the time
  yahboomd record run1 --for 60
  yahboomd record /data/today --max-size 2G    the newest 2 GB are kept
  ros2 bag play run1
  yahboomd record run1 --recover               run1 was cut off: write run1-recovered, whole

exit status:
  0    ended by --for or Ctrl-C; the last line counts recorded and lost messages
  1    the folder exists, or the disk is full or lost; with --recover: it has no recording
  69   no daemon is there
  78   a mistake in the configuration
"""

_SIZE = re.compile(r"(\d{1,15}(?:\.\d+)?)\s*([kMGT]?)B?", re.IGNORECASE)
SMALLEST_BYTES = 1_000_000


def size(text: str) -> int:
    """A size such as ``500M`` in bytes."""
    found = _SIZE.fullmatch(text.strip())
    value = 0
    if found is not None:
        value = int(float(found[1]) * 1000.0 ** " kmgt".index(found[2].lower() or " "))
    if value < SMALLEST_BYTES:
        raise argparse.ArgumentTypeError(f"{text} is not a size of 1M or more, such as 500M or 2G")
    return value


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        "folder", metavar="FOLDER", nargs="?", type=Path, help="a new folder (default: by the time)"
    )
    parser.add_argument(
        "--for",
        dest="for_s",
        metavar="SECONDS",
        type=number("a number of seconds above 0", lambda s: s > 0.0),
        default=math.inf,
        help="how long (default: until Ctrl-C)",
    )
    parser.add_argument(
        "--max-size",
        metavar="SIZE",
        type=size,
        default=0,
        help="the most that is kept, such as 2G: the oldest parts are removed",
    )
    parser.add_argument(
        "--split", metavar="SIZE", type=size, default=0, help="begin another file at this size"
    )
    parser.add_argument(
        "--attached",
        action="store_true",
        help="end when standard input ends: with the program that started it, however that ends",
    )
    parser.add_argument(
        "--recover",
        action="store_true",
        help="record nothing: write the recording in FOLDER again, with the index that it lacks "
        "since its recorder was killed, into FOLDER-recovered",
    )
    parser.add_argument("--json", action="store_true", help="print the result as one line of JSON")
    add_robot_options(parser)


def run(args: argparse.Namespace) -> int:
    """Record."""
    # Imported first, so that a missing extra is reported before anything is made.
    import mcap.writer  # noqa: F401

    if args.recover:
        return _recover(args.folder, as_json=args.json)

    from yahboomd.core.daemon.process import deadly

    ended = attend(args, lambda robot: _record(robot, args), signals=deadly())
    return os.EX_OK if ended in {128 + signal.SIGINT, 128 + signal.SIGTERM} else ended


def _recover(folder: Path | None, *, as_json: bool) -> int:
    from yahboomd.tools.record.bus_recorder import recover

    if folder is None:
        print("yahboomd record: error: --recover takes the FOLDER of a recording", file=sys.stderr)
        return 2
    target, messages, cut = recover(folder)
    facts = {"folder": str(target), "messages": messages, "cut_files": cut}
    words = f"{target}: {messages} messages, of {cut} files that were cut off."
    print(json.dumps(facts) if as_json else words)
    return os.EX_OK


async def _record(robot: AsyncRobot, args: argparse.Namespace) -> int:
    from yahboomd.tools.record.bus_recorder import RecordingEnd, record

    folder = args.folder or Path(f"robot-{datetime.datetime.now().astimezone():%Y-%m-%d-%H%M%S}")

    def told(seconds: float, facts: dict[str, int]) -> None:
        if seconds == 0.0:
            print(f"Recording to {folder}; Ctrl-C ends it.", file=sys.stderr)
        elif sys.stderr.isatty():
            line = (
                f"\r{seconds:5.0f} s  {facts['messages']} messages  "
                f"{facts['bytes'] / 1e6:.1f} MB  {facts['lost']} lost "
            )
            print(line, end="", file=sys.stderr, flush=True)

    def ended(end: RecordingEnd) -> None:
        if sys.stderr.isatty():
            print(file=sys.stderr)
        facts = {"folder": str(folder), **end.facts}
        print(json.dumps(facts) if args.json else _words(folder, end.facts))
        if end.problem:
            raise Refused(end.problem)

    await record(
        robot,
        folder,
        split_bytes=args.split,
        max_bytes=args.max_size,
        until=lambda: _over(args.for_s, attached=args.attached),
        told=told,
        ended=ended,
    )
    return os.EX_OK


async def _over(for_s: float, *, attached: bool) -> None:
    """Wait for the end of the time, or of standard input."""
    waits = asyncio.create_task(input_ended()) if attached else asyncio.Future[None]()
    try:
        await asyncio.wait({waits}, timeout=None if math.isinf(for_s) else for_s)
    finally:
        waits.cancel()


def _words(folder: Path, facts: dict[str, int]) -> str:
    words = (
        f"{folder}: {facts['messages']} messages, {facts['bytes'] / 1e6:.1f} MB, "
        f"{facts['lost']} samples lost on the way."
    )
    if facts["unreadable"]:
        words += f" {facts['unreadable']} payloads were no messages, and are left out."
    if facts["removed_parts"]:
        words += f" {facts['removed_parts']} older parts were removed for --max-size."
    return words
