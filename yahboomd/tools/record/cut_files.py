"""Reads recordings that were cut off, from the front, and writes them again with an index.

If a recorder is killed, its file lacks the index, and its last chunk is incomplete. Readers that
need the index first, such as rosbags, refuse such a file.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from yahboomd.tools.record.mcap_files import Channel, McapFiles

if TYPE_CHECKING:
    from mcap.records import Channel as McapChannel
    from mcap.records import Message, Schema

QOS = "offered_qos_profiles"
"""The metadata of a channel that holds ROS 2's quality of service."""


class Cut(Exception):
    """The file is damaged from here on, or no recording at all."""


def parts(folder: Path, name: str) -> list[Path]:
    """The files of one row of a recording, oldest first, without copies that a person made."""
    found = [
        each for each in folder.glob(f"{name}_*.mcap") if each.stem[len(name) + 1 :].isdecimal()
    ]
    return sorted(found, key=lambda each: int(each.stem[len(name) + 1 :]))


def read_from_front(file: Path) -> Iterator[tuple[Schema | None, McapChannel, Message]]:
    """Read the messages of a file, without its index.

    Raises:
        Cut: It ends in the middle of a chunk, or is damaged.
        OSError: It cannot be read.
    """
    from mcap.exceptions import McapError
    from mcap.reader import NonSeekingReader
    from zstandard import ZstdError

    with file.open("rb") as stream:
        reader = NonSeekingReader(stream, validate_crcs=True)
        try:
            yield from reader.iter_messages(log_time_order=False)
        except (McapError, ZstdError, ValueError, EOFError, OverflowError, struct.error) as error:
            raise Cut(str(error) or "it ends too early") from error


def copy_whole(source: Path, name: str, target: Path, *, is_bag: bool) -> tuple[int, int]:
    """Write one row of a recording again, with its index.

    Args:
        source: The folder of the recording.
        name: The start of the names of the row's files.
        target: An existing folder.
        is_bag: See :class:`~yahboomd.tools.record.mcap_files.McapFiles`.

    Returns:
        The number of messages, and the number of files that were cut.

    Raises:
        OSError: A file cannot be read, or the disk is full.
    """
    cut = 0
    files = parts(source, name)
    copy = McapFiles(
        target,
        name,
        split_bytes=max(each.stat().st_size for each in files) if len(files) > 1 else 0,
        facts=_facts(files),
        is_bag=is_bag,
    )
    try:
        for file in files:
            try:
                for schema, channel, message in read_from_front(file):
                    copy.write(
                        Channel(
                            topic=channel.topic,
                            message_encoding=channel.message_encoding,
                            schema=schema.name if schema else "",
                            schema_encoding=schema.encoding if schema else "",
                            schema_text=schema.data.decode() if schema else "",
                            qos=channel.metadata.get(QOS, ""),
                        ),
                        message.data,
                        logged_ns=message.log_time,
                        published_ns=message.publish_time,
                        sequence=message.sequence,
                    )
            except Cut:
                cut += 1
    finally:
        copy.end()
    return copy.messages, cut


def _facts(files: list[Path]) -> dict[str, str]:
    """The daemon's configuration, from the beginning of the first readable file."""
    from mcap.exceptions import McapError
    from mcap.reader import NonSeekingReader

    for file in files:
        with file.open("rb") as stream:
            try:
                for each in NonSeekingReader(stream).iter_metadata():
                    return dict(each.metadata)
            except (McapError, ValueError, EOFError, OverflowError, struct.error):
                continue
    return {}
