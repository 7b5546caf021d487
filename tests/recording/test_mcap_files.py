"""Recordings as readers that were not written here see them, whole and cut."""

from __future__ import annotations

import io
import json
import struct
from pathlib import Path

import pytest
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, make_reader

from yahboomd.tools.record.mcap_files import CHUNK_BYTES, Channel, McapFiles

POSE = Channel("yahboomd/pose", "json", "PoseSample", "jsonschema", '{"type": "object"}')
BOOL = Channel("/estopped", "cdr", "std_msgs/msg/Bool", "ros2msg", "bool data\n", "- depth: 1")
START_NS = 1_700_000_000_000_000_000


def write(files: McapFiles, count: int, channel: Channel = POSE, size: int = 300) -> None:
    """Messages that do not compress."""
    for number in range(count):
        text = bytes((number * 7919 + i * i * 31) % 256 for i in range(size))
        at_ns = START_NS + number * 20_000_000
        files.write(
            channel,
            json.dumps({"seq": number, "x": text.hex()}).encode(),
            logged_ns=at_ns,
            published_ns=at_ns - 5,
            sequence=number,
        )


def messages(data: bytes) -> list[int]:
    """The numbers of the messages that the library's recovery finds in a cut file."""
    found = []
    try:
        for _, _, message in NonSeekingReader(io.BytesIO(data)).iter_messages(log_time_order=False):
            found.append(message.sequence)
    except (McapError, ValueError, EOFError, struct.error):
        pass
    return found


def test_a_whole_file_has_every_message_with_schema_times_and_facts(tmp_path: Path) -> None:
    files = McapFiles(tmp_path, "native", facts={"chassis": "{}"})
    write(files, 500)
    files.end()
    with (tmp_path / "native_0.mcap").open("rb") as stream:
        reader = make_reader(stream)
        found = list(reader.iter_messages())
        assert [message.sequence for _, _, message in found] == list(range(500))
        schema, channel, message = found[3]
        assert schema is not None
        assert (schema.name, schema.encoding) == ("PoseSample", "jsonschema")
        assert (channel.topic, channel.message_encoding) == ("yahboomd/pose", "json")
        assert message.log_time == START_NS + 60_000_000
        assert message.publish_time == message.log_time - 5
        assert [each.metadata for each in reader.iter_metadata()] == [{"chassis": "{}"}]


def test_a_file_cut_anywhere_lacks_its_last_chunk_at_most(tmp_path: Path) -> None:
    files = McapFiles(tmp_path, "native")
    write(files, 3000)
    whole = (tmp_path / "native_0.mcap").read_bytes()
    files.end()
    assert len(whole) > 5 * CHUNK_BYTES // 2, "several chunks are on the disk before the end"
    full = messages(whole)
    assert full == list(range(len(full)))
    assert len(full) > 2500
    for cut in range(len(whole) // 7, len(whole), len(whole) // 23):
        found = messages(whole[:cut])
        assert found == full[: len(found)]
        # The uncompressed size of a chunk bounds the loss by a cut one.
        lost = cut / len(whole) * len(full) - len(found)
        assert lost < 2.0 * CHUNK_BYTES / 600, (cut, lost)


def test_parts_split_and_the_oldest_goes_where_they_take_too_much_room(tmp_path: Path) -> None:
    files = McapFiles(tmp_path, "native", split_bytes=300_000, max_bytes=1_000_000)
    most = 0
    for _ in range(20):
        write(files, 500)
        size = sum(path.stat().st_size for path in tmp_path.glob("*.mcap"))
        assert files.written_bytes == size
        most = max(most, size)
    files.end()
    assert files.written_bytes == sum(path.stat().st_size for path in tmp_path.glob("*.mcap"))
    assert files.removed > 0
    assert most < 1_000_000 + CHUNK_BYTES
    assert not (tmp_path / "native_0.mcap").exists()
    kept = sorted(tmp_path.glob("*.mcap"), key=lambda path: int(path.stem.split("_")[1]))
    assert len(kept) >= 2
    for path in kept:
        with path.open("rb") as stream:
            assert list(make_reader(stream).iter_messages())


def test_only_a_bag_has_the_metadata_of_ros(tmp_path: Path) -> None:
    for name, is_bag in (("native", False), ("ros2", True)):
        files = McapFiles(tmp_path, name, is_bag=is_bag)
        write(files, 3, BOOL)
        files.end()
        assert (tmp_path / "metadata.yaml").exists() is is_bag
    text = (tmp_path / "metadata.yaml").read_text()
    assert "name: /estopped" in text
    assert "message_count: 3" in text
    assert "- ros2_0.mcap" in text


def test_nothing_to_record_makes_no_file(tmp_path: Path) -> None:
    files = McapFiles(tmp_path, "ros2", is_bag=True)
    files.sync()
    files.end()
    assert list(tmp_path.iterdir()) == []
    assert (files.messages, files.written_bytes) == (0, 0)


def test_a_disk_that_is_full_is_an_error_of_the_system(tmp_path: Path) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    files = McapFiles(tmp_path, "native")
    write(files, 1)
    # Swapped for a device on which every write finds no room.
    import os

    full = os.open("/dev/full", os.O_WRONLY)
    os.dup2(full, files._stream._fd)
    os.close(full)
    with pytest.raises(OSError, match="No space left"):
        write(files, 1000)
