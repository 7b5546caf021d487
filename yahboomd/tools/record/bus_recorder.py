"""Records what a robot publishes into a folder, and makes a cut recording whole again."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import Annotated, NamedTuple

import msgspec

from yahboomd.client import AsyncRobot
from yahboomd.core.bus.subscriptions import Arrival
from yahboomd.core.clock import SystemClock
from yahboomd.core.config import read_foreign
from yahboomd.core.daemon.stamps import WallStamps
from yahboomd.core.errors import Refused
from yahboomd.tools.record.cut_files import copy_whole, parts
from yahboomd.tools.record.mcap_files import NATIVE, ROS, Channel, McapFiles
from yahboomd.tools.record.recorded_topics import Recorded, facts_of, recorded

DEPTH = 2000
"""Samples of one key to queue for a slow disk: 40 s at 50 Hz."""

GATHER_S = 0.1
"""The period at which samples are taken from Zenoh: one by one costs three times as much."""

SYNC_S = 2.0
REPORT_S = 1.0


class RecordingEnd(NamedTuple):
    """The end of a recording.

    Attributes:
        facts: The counts, as :meth:`TopicRecorder.facts` has them.
        problem: Why it ended early; empty if it did not.
    """

    facts: dict[str, int]
    problem: str


async def record(
    robot: AsyncRobot,
    folder: Path,
    *,
    split_bytes: int,
    max_bytes: int,
    until: Callable[[], Awaitable[None]],
    told: Callable[[float, dict[str, int]], None],
    ended: Callable[[RecordingEnd], None],
) -> None:
    """Record into a new folder until it is over, cancelled, or the disk fails.

    Args:
        split_bytes: The size at which another file begins; 0 for never.
        max_bytes: The most that is kept, the newest; 0 for all.
        until: Waits for the end of the recording, from its beginning on.
        told: Is told the seconds and the counts, at the beginning and once a second.
        ended: Is told the end, whatever led to it; it may raise.

    Raises:
        Refused: The folder cannot be made.
    """
    data = await robot.config()
    config = read_foreign(data, "The daemon")
    try:
        await asyncio.to_thread(folder.mkdir, parents=True)
    except OSError as error:
        raise Refused(f"{folder} cannot be made: {error.strerror}. Name a new folder.") from error
    native, ros = (
        McapFiles(
            folder,
            name,
            split_bytes=split_bytes,
            max_bytes=max_bytes // 2,
            facts=facts_of(data),
            is_bag=name == ROS,
        )
        for name in (NATIVE, ROS)
    )
    stamps = WallStamps(SystemClock(), lambda _: None)
    recorder = TopicRecorder(native, ros, lambda at_ns: at_ns + stamps.follow())
    for each in recorded(config):
        robot.bus.subscribe(
            each.key,
            partial(recorder.take, each),
            depth=DEPTH,
            max_bytes=1_000_000,
            gather_s=GATHER_S,
        )
    over = asyncio.ensure_future(until())
    elapsed = 0.0
    try:
        told(elapsed, recorder.facts())
        while not (over.done() or recorder.problem):
            await asyncio.wait({over}, timeout=REPORT_S)
            elapsed += REPORT_S
            if elapsed % SYNC_S == 0.0:
                await asyncio.to_thread(recorder.sync)
            told(elapsed, recorder.facts())
    finally:
        over.cancel()
        ended(RecordingEnd(recorder.end(), recorder.problem))


def recover(folder: Path) -> tuple[Path, int, int]:
    """Write a recording that was cut off again, whole, into a folder beside it.

    Returns:
        The new folder, the number of its messages, and how many files were cut off.

    Raises:
        Refused: There is no recording, or the new folder cannot be written.
    """
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
    return target, messages, cut


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
