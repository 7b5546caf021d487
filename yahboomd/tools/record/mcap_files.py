"""Writes MCAP files: a recording in parts of bounded size, in a folder that ``ros2 bag`` plays.

Chunks are small and are written at once, unbuffered. If a file is cut, or its recorder killed, only
the index and the last chunk are lost: readers get the rest by reading from the front
(https://mcap.dev/spec).
"""

from __future__ import annotations

import os
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from yahboomd.core.atomic_write import sync_folder, write_atomic

if TYPE_CHECKING:
    from mcap.writer import Writer

NATIVE = "native"
ROS = "ros2"
"""The two rows of files of a recording, because readers of ROS 2 bags fail on JSON schemas."""

CHUNK_BYTES = 128 * 1024
"""About three seconds of a moving robot, uncompressed."""

METADATA = "metadata.yaml"
"""Written when a part has ended, for ``ros2 bag`` and other readers of its folders."""


class Channel(NamedTuple):
    """A topic in one encoding.

    Attributes:
        message_encoding: ``json`` or ``cdr``.
        schema: Name of the message's type.
        schema_encoding: ``jsonschema`` or ``ros2msg``; empty without a schema.
        qos: ROS 2's quality of service in YAML, for topics of ROS 2.
    """

    topic: str
    message_encoding: str
    schema: str
    schema_encoding: str
    schema_text: str
    qos: str = ""


@dataclass
class Part:
    """One file of a recording.

    Attributes:
        first_ns: When its first message was recorded; Unix nanoseconds.
    """

    path: Path
    size: int = 0
    first_ns: int = 0
    last_ns: int = 0
    counts: dict[Channel, int] = field(default_factory=dict)


class McapFiles:
    """Writes messages into parts, and removes the oldest parts to stay below a size.

    Args:
        folder: An existing folder.
        name: The start of the parts' names.
        split_bytes: The size at which the next part begins; 0 for a single part.
        max_bytes: The most bytes of all parts together; 0 for no bound.
        facts: Metadata for each part, such as the daemon's configuration.
        is_bag: Whether the folder gets the ``metadata.yaml`` of a ROS 2 bag with these parts.

    Attributes:
        removed: The number of parts removed to stay below ``max_bytes``.
    """

    def __init__(
        self,
        folder: Path,
        name: str,
        *,
        split_bytes: int = 0,
        max_bytes: int = 0,
        facts: dict[str, str] | None = None,
        is_bag: bool = False,
    ) -> None:
        self._folder = folder
        self._name = name
        self._is_bag = is_bag
        # At least four parts, so that a removal leaves most of the recording.
        self._split_bytes = min(filter(None, (split_bytes, max_bytes // 4)), default=0)
        self._max_bytes = max_bytes
        self._facts = facts or {}
        self._parts: list[Part] = []
        self._number = 0
        self._ended: list[_Unbuffered] = []
        self._metadata = ""
        self._syncing = threading.Lock()
        self.removed = 0

    @property
    def written_bytes(self) -> int:
        """The size of the parts that exist."""
        return sum(part.size for part in self._parts)

    @property
    def messages(self) -> int:
        """The messages in the parts that exist."""
        return sum(sum(part.counts.values()) for part in self._parts)

    def write(
        self, channel: Channel, data: bytes, *, logged_ns: int, published_ns: int, sequence: int
    ) -> None:
        """Add a message.

        Args:
            logged_ns: When it arrived; Unix nanoseconds.
            published_ns: When it was published; Unix nanoseconds.
            sequence: Its number, if its sender counts.

        Raises:
            OSError: The disk is full, or lost.
        """
        if not self._parts:
            self._begin()
        elif self._split_bytes and self._stream.size >= self._split_bytes:
            self._end_part()
            self._begin()
            self._make_room()
        part = self._parts[-1]
        number = self._ids.get(channel)
        if number is None:
            number = self._ids[channel] = self._register(channel)
        self._writer.add_message(number, logged_ns, data, published_ns, sequence)
        part.counts[channel] = part.counts.get(channel, 0) + 1
        part.first_ns = part.first_ns or logged_ns
        part.last_ns = logged_ns
        part.size = self._stream.size

    def sync(self) -> None:
        """Write everything to the disk itself, and the metadata of the parts that have ended.

        This is slow, so call it in a thread.
        """
        with self._syncing:
            if not self._parts:
                return
            metadata, self._metadata = self._metadata, ""
            while self._ended:
                self._ended[0].sync()
                self._ended.pop(0).close()
            self._stream.sync()
            if metadata:
                write_atomic(self._folder / METADATA, metadata.encode())
            sync_folder(self._folder)

    def end(self) -> None:
        """End the current part with its index, and write the folder's metadata."""
        if self._parts:
            self._end_part()
            self.sync()

    def _end_part(self) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._parts[-1].size = self._stream.size
        # The thread that syncs closes it.
        self._ended.append(self._stream)
        self._metadata = _metadata(self._parts) if self._is_bag else ""

    def _begin(self) -> None:
        from mcap.writer import CompressionType, Writer

        path = self._folder / f"{self._name}_{self._number}.mcap"
        self._number += 1
        self._stream = _Unbuffered(path)
        self._writer: Writer = Writer(
            self._stream,  # type: ignore[arg-type]
            chunk_size=CHUNK_BYTES,
            compression=CompressionType.ZSTD,
        )
        self._writer.start(profile="ros2" if self._is_bag else "", library="yahboomd")
        if self._facts:
            self._writer.add_metadata("yahboomd", self._facts)
        self._ids: dict[Channel, int] = {}
        self._parts.append(Part(path))

    def _register(self, channel: Channel) -> int:
        schema = 0
        if channel.schema_encoding:
            schema = self._writer.register_schema(
                channel.schema, channel.schema_encoding, channel.schema_text.encode()
            )
        metadata = {"offered_qos_profiles": channel.qos} if channel.qos else {}
        return self._writer.register_channel(
            channel.topic, channel.message_encoding, schema, metadata
        )

    def _make_room(self) -> None:
        """Remove the oldest parts until the newest one can grow to its full size."""
        while (
            self._max_bytes
            and len(self._parts) > 1
            and self.written_bytes + self._split_bytes > self._max_bytes
        ):
            self._parts.pop(0).path.unlink()
            self.removed += 1


class _Unbuffered:
    """A file without a buffer, so that nothing is lost if this process is killed."""

    def __init__(self, path: Path) -> None:
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        self.size = 0

    def write(self, data: bytes) -> int:
        view = memoryview(data)
        while view:
            view = view[os.write(self._fd, view) :]
        self.size += len(data)
        return len(data)

    def tell(self) -> int:
        return self.size

    def flush(self) -> None:
        """Do nothing: nothing is buffered."""

    def sync(self) -> None:
        if self._fd >= 0:
            os.fdatasync(self._fd)

    def close(self) -> None:
        os.close(self._fd)
        self._fd = -1


def _metadata(parts: list[Part]) -> str:
    """The folder's ``metadata.yaml`` (rosbag2, version 5): the topics of ROS 2 and the files."""
    begin = min((part.first_ns for part in parts if part.first_ns), default=0)
    end = max(part.last_ns for part in parts)
    totals: dict[Channel, int] = {}
    for part in parts:
        for channel, count in part.counts.items():
            totals[channel] = totals.get(channel, 0) + count
    lines = [
        "rosbag2_bagfile_information:",
        "  version: 5",
        "  storage_identifier: mcap",
        f"  duration: {{nanoseconds: {max(0, end - begin)}}}",
        f"  starting_time: {{nanoseconds_since_epoch: {begin}}}",
        f"  message_count: {sum(totals.values())}",
        "  topics_with_message_count:" if totals else "  topics_with_message_count: []",
    ]
    for channel, count in totals.items():
        lines += [
            "    - topic_metadata:",
            f"        name: {channel.topic}",
            f"        type: {channel.schema}",
            "        serialization_format: cdr",
            f'        offered_qos_profiles: "{channel.qos.replace(chr(10), chr(92) + "n")}"',
            f"      message_count: {count}",
        ]
    lines += ['  compression_format: ""', '  compression_mode: ""', "  relative_file_paths:"]
    lines += [f"    - {part.path.name}" for part in parts]
    lines.append("  files:")
    for part in parts:
        lines += [
            f"    - path: {part.path.name}",
            f"      starting_time: {{nanoseconds_since_epoch: {part.first_ns}}}",
            f"      duration: {{nanoseconds: {part.last_ns - part.first_ns}}}",
            f"      message_count: {sum(part.counts.values())}",
        ]
    return "\n".join(lines) + "\n"
