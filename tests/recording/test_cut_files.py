"""Recordings that were cut off, read and written again."""

from __future__ import annotations

from pathlib import Path

import pytest
from mcap.reader import make_reader

from yahboomd.tools.record.cut_files import Cut, copy_whole, parts, read_from_front
from yahboomd.tools.record.mcap_files import NATIVE, Channel, McapFiles

POSES = Channel("pose", "json", "PoseSample", "jsonschema", "{}")
EVENTS = Channel("events", "json", "", "", "")


def record(folder: Path, count: int, *, split_bytes: int = 0) -> list[bytes]:
    files = McapFiles(folder, NATIVE, split_bytes=split_bytes, facts={"chassis": "{}"})
    sent = [b'{"seq": %d, "x": "%s"}' % (n, b"%d" % (n * n) * 20) for n in range(count)]
    for n, data in enumerate(sent):
        channel = EVENTS if n % 7 == 0 else POSES
        files.write(channel, data, logged_ns=n + 1, published_ns=n, sequence=n)
    files.end()
    return sent


def messages(file: Path) -> list[bytes]:
    """As a reader has them that looks for the index first."""
    with file.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        found = [message.data for _, _, message in reader.iter_messages()]
        assert summary.statistics.message_count == len(found)
        assert [each.metadata for each in reader.iter_metadata()] == [{"chassis": "{}"}]
        return found


@pytest.mark.parametrize("share", [0.999, 0.7, 0.5, 0.3, 0.02])
def test_of_a_file_that_was_cut_each_whole_chunk_is_kept(tmp_path: Path, share: float) -> None:
    before, after = tmp_path / "run", tmp_path / "copy"
    before.mkdir()
    after.mkdir()
    sent = record(before, 6000)
    part = before / "native_0.mcap"
    data = part.read_bytes()
    part.write_bytes(data[: int(len(data) * share)])
    readable = []
    with pytest.raises(Cut):
        readable.extend(message.data for _, _, message in read_from_front(part))
    count, cut = copy_whole(before, NATIVE, after, is_bag=False)
    assert cut == 1
    assert len(list(after.glob("*.mcap"))) == (1 if count else 0)
    if count:
        assert messages(after / "native_0.mcap") == sent[:count]
    assert count >= len(readable)
    assert count > 0 or share == 0.02


def test_parts_that_are_whole_are_copied_whole(tmp_path: Path) -> None:
    before, after = tmp_path / "run", tmp_path / "copy"
    before.mkdir()
    after.mkdir()
    sent = record(before, 6000, split_bytes=40_000)
    (before / "native_0 (copy).mcap").write_bytes(b"")
    files = parts(before, NATIVE)
    assert len(files) > 2
    assert copy_whole(before, NATIVE, after, is_bag=False) == (6000, 0)
    assert [data for file in parts(after, NATIVE) for data in messages(file)] == sent
