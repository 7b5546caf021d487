"""``yahboomd record``: writes the messages of the bus to MCAP files."""

from __future__ import annotations

import argparse
import asyncio
import datetime
import errno
import json
import math
import os
import re
import signal
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec

from yahboomd.cli.attended import add_robot_options, attend
from yahboomd.cli.shared_options import number
from yahboomd.core.errors import Refused
from yahboomd.tools.record.mcap_files import NATIVE, ROS
from yahboomd.tools.terminal.input_lines import input_ended

if TYPE_CHECKING:
    from collections.abc import Callable

    from yahboomd.client import AsyncRobot
    from yahboomd.core.bus.subscriptions import Arrival
    from yahboomd.tools.record.mcap_files import Channel, McapFiles
    from yahboomd.tools.record.recorded_topics import Recorded

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

DEPTH = 2000
"""Samples of one key to queue for a slow disk: 40 s at 50 Hz."""

GATHER_S = 0.1
"""The period at which samples are taken from Zenoh: one by one costs three times as much."""

SYNC_S = 2.0
REPORT_S = 1.0

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
        type=number("a number of seconds above 0", lambda s: math.isfinite(s) and s > 0.0),
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
    from yahboomd.tools.record.cut_files import copy_whole, parts

    if folder is None:
        print("yahboomd record: error: --recover takes the FOLDER of a recording", file=sys.stderr)
        return 2
    rows = [name for name in (NATIVE, ROS) if parts(folder, name)]
    if not rows:
        raise Refused(f"{folder} has no recording: neither native_0.mcap nor ros2_0.mcap.")
    target = folder.absolute().with_name(f"{folder.absolute().name}-recovered")
    try:
        target.mkdir()
        done = [copy_whole(folder, name, target, is_bag=name == ROS) for name in rows]
    except OSError as error:
        path = error.filename or target
        raise Refused(f"{path}: {error.strerror or error}. {folder} is as it was.") from error
    messages, cut = (sum(each) for each in zip(*done, strict=True))
    facts = {"folder": str(target), "messages": messages, "cut_files": cut}
    words = f"{target}: {messages} messages, of {cut} files that were cut off."
    print(json.dumps(facts) if as_json else words)
    return os.EX_OK


async def _record(robot: AsyncRobot, args: argparse.Namespace) -> int:
    from yahboomd.core.clock import SystemClock
    from yahboomd.core.config import read_foreign
    from yahboomd.core.daemon.stamps import WallStamps
    from yahboomd.tools.record.mcap_files import McapFiles
    from yahboomd.tools.record.recorded_topics import facts_of, recorded

    clock = SystemClock()
    data = await robot.config()
    config = read_foreign(data, "The daemon")
    folder = args.folder or Path(f"robot-{datetime.datetime.now().astimezone():%Y-%m-%d-%H%M%S}")
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise Refused(f"{folder} cannot be made: {error.strerror}. Name a new folder.") from error
    native, ros = (
        McapFiles(
            folder,
            name,
            split_bytes=args.split,
            max_bytes=args.max_size // 2,
            facts=facts_of(data),
            is_bag=name == ROS,
        )
        for name in (NATIVE, ROS)
    )
    stamps = WallStamps(clock, lambda _: None)
    recorder = TopicRecorder(native, ros, lambda at_ns: at_ns + stamps.follow())
    for each in recorded(config):
        robot.bus.subscribe(
            each.key,
            partial(recorder.take, each),
            depth=DEPTH,
            max_bytes=1_000_000,
            gather_s=GATHER_S,
        )
    print(f"Recording to {folder}; Ctrl-C ends it.", file=sys.stderr)
    try:
        async with asyncio.timeout(None if math.isinf(args.for_s) else args.for_s):
            await _watch(recorder, attached=args.attached)
    except TimeoutError:
        pass
    finally:
        facts = recorder.end()
        if sys.stderr.isatty():
            print(file=sys.stderr)
        print(json.dumps({"folder": str(folder), **facts}) if args.json else _words(folder, facts))
        if recorder.problem:
            raise Refused(recorder.problem)
    return os.EX_OK


async def _watch(recorder: TopicRecorder, *, attached: bool) -> None:
    """Sync the disk and show progress, until the input ends or the disk fails."""
    ended = asyncio.create_task(input_ended()) if attached else asyncio.Future[None]()
    elapsed = 0.0
    try:
        while not (ended.done() or recorder.problem):
            await asyncio.wait({ended}, timeout=REPORT_S)
            elapsed += REPORT_S
            if elapsed % SYNC_S == 0.0:
                await asyncio.to_thread(recorder.sync)
            if sys.stderr.isatty():
                facts = recorder.facts()
                line = (
                    f"\r{elapsed:5.0f} s  {facts['messages']} messages  "
                    f"{facts['bytes'] / 1e6:.1f} MB  {facts['lost']} lost "
                )
                print(line, end="", file=sys.stderr, flush=True)
    finally:
        ended.cancel()


class _Numbered(msgspec.Struct):
    # MCAP has 32 bits for it.
    seq: Annotated[int, msgspec.Meta(ge=0, lt=1 << 32)] | None = None


def _number(channel: Channel, payload: bytes) -> int | None:
    """The sequence number of a native sample; None for any other message."""
    if channel.message_encoding != "json":
        return None
    return msgspec.json.decode(payload, type=_Numbered).seq


class TopicRecorder:
    """Writes samples, and counts the missing and unreadable ones.

    Attributes:
        lost: Samples that were published and did not arrive here, by their sequence numbers.
        unreadable: Payloads that were no message of their key.
        problem: Why nothing can be written any more; empty while it can.
    """

    def __init__(self, native: McapFiles, ros: McapFiles, wall_ns: Callable[[int], int]) -> None:
        self._files = {"json": native, "cdr": ros}
        self.lost = 0
        self.unreadable = 0
        self.problem = ""
        self._wall_ns = wall_ns
        self._sequences: dict[str, int] = {}
        self._arrived_ns: dict[str, int] = {}

    def take(self, topic: Recorded, arrivals: list[Arrival]) -> None:
        """Write the samples that arrived on a topic."""
        for arrival in arrivals:
            self._take(topic, arrival)

    def _take(self, topic: Recorded, arrival: Arrival) -> None:
        if self.problem:
            return
        try:
            found = topic.channel(arrival.payload)
            number = _number(*found) if found is not None else None
        except (msgspec.DecodeError, RecursionError):
            found = None
        if found is None:
            self.unreadable += 1
            return
        channel, payload = found
        # Samples arrive in order, but the times of gathered ones are estimates.
        arrived_ns = max(arrival.arrived_ns, self._arrived_ns.get(topic.key, 0))
        self._arrived_ns[topic.key] = arrived_ns
        logged_ns = self._wall_ns(arrived_ns)
        if number is None:
            self.lost += arrival.dropped
        else:
            self._find_gap(topic.key, number)
        try:
            self._files[channel.message_encoding].write(
                channel,
                payload,
                logged_ns=logged_ns,
                published_ns=arrival.stamp_ns or logged_ns,
                sequence=number or 0,
            )
        except OSError as error:
            self._fail(error)

    def _fail(self, error: OSError) -> None:
        self.problem = self.problem or f"The recording ends: {error.strerror or error}."

    def _find_gap(self, key: str, number: int) -> None:
        """Count the native samples that are missing before this one as lost."""
        before = self._sequences.get(key)
        self._sequences[key] = number
        # A restarted daemon counts from the beginning.
        if before is not None and number > before:
            self.lost += number - before - 1

    def sync(self) -> None:
        """Write everything to the disk itself. This is slow, so call it in a thread."""
        for files in self._files.values():
            try:
                files.sync()
            except OSError as error:
                # The part may have ended meanwhile.
                if error.errno != errno.EBADF:
                    self._fail(error)

    def facts(self) -> dict[str, int]:
        """The present counts."""
        files = self._files.values()
        return {
            "messages": sum(each.messages for each in files),
            "bytes": sum(each.written_bytes for each in files),
            "lost": self.lost,
            "unreadable": self.unreadable,
            "removed_parts": sum(each.removed for each in files),
        }

    def end(self) -> dict[str, int]:
        """End the files; returns the counts."""
        for files in self._files.values():
            try:
                files.end()
            except OSError as error:
                self._fail(error)
        return self.facts()


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
