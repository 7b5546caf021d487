"""Reads the series of a recording, by the time since its first sample."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import msgspec

from yahboomd.client.streams import read_sample
from yahboomd.core.bus import keys
from yahboomd.core.errors import Refused
from yahboomd.core.messages.native import (
    BatterySample,
    EventSample,
    PoseSample,
    StatusSample,
    WheelsSample,
)
from yahboomd.core.model import NS_PER_S
from yahboomd.tools.record.cut_files import Cut, parts, read_from_front
from yahboomd.tools.record.mcap_files import NATIVE

Sample = TypeVar("Sample", bound=msgspec.Struct)

MESSAGES: dict[str, type[msgspec.Struct]] = {
    keys.POSE: PoseSample,
    keys.WHEELS: WheelsSample,
    keys.BATTERY: BatterySample,
    keys.STATUS: StatusSample,
    keys.EVENTS: EventSample,
}


@dataclass
class Recording:
    """The samples of a recording.

    Attributes:
        begin_ns: The first stamp; Unix nanoseconds.
        samples: The messages, in the order of the files.
        is_cut: Whether a file is damaged, or ended in the middle of a chunk.
    """

    begin_ns: int = 0
    samples: list[msgspec.Struct] = field(default_factory=list)
    is_cut: bool = False

    def of(self, message: type[Sample]) -> list[Sample]:
        """The messages of one kind, oldest first."""
        return [each for each in self.samples if isinstance(each, message)]

    def time_s(self, stamp_ns: int) -> float:
        """The time since the first sample."""
        return (stamp_ns - self.begin_ns) / NS_PER_S


def read_recording(path: Path) -> Recording:
    """Read a folder that ``yahboomd record`` made, or one of its native files, complete or cut.

    Raises:
        Refused: It holds no sample of a robot.
    """
    files = [path]
    if path.is_dir():
        files = parts(path, NATIVE)
    recording = Recording()
    for file in files:
        for topic, data in _messages(file, recording):
            message = MESSAGES.get(topic)
            if message is not None and (sample := read_sample(data, message)) is not None:
                recording.samples.append(sample)
    stamps = [each.stamp_ns for each in recording.of(PoseSample)]
    stamps += [each.stamp_ns for each in recording.of(StatusSample)]
    if not stamps:
        raise Refused(
            f"{path} has neither poses nor statuses of yahboomd. Name a folder that "
            "`yahboomd record` made, or a native_0.mcap in it."
        )
    recording.begin_ns = min(stamps)
    return recording


def _messages(file: Path, recording: Recording) -> Iterator[tuple[str, bytes]]:
    try:
        for _, channel, message in read_from_front(file):
            yield channel.topic, message.data
    except OSError as error:
        raise Refused(f"The recording {file} cannot be read: {error.strerror}.") from error
    except Cut as cut:
        if not recording.samples:
            words = f"{file} is no recording, or damaged from its beginning"
            raise Refused(f"{words}: {cut}.") from cut
        recording.is_cut = True
