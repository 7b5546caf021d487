"""Recordings as series: whole, in parts, cut off, and other files."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from random import Random

import pytest
from pose_recording import record

from yahboomd.core.errors import Refused
from yahboomd.core.messages.native import PoseSample
from yahboomd.tools.plot.recorded_series import read_recording


def test_all_parts_of_a_folder_are_read_in_their_order(tmp_path: Path) -> None:
    record(tmp_path, 9000, split=20_000)
    assert len(list(tmp_path.glob("native_*.mcap"))) > 10, "names sort by number, not by letter"
    recording = read_recording(tmp_path)
    poses = recording.of(PoseSample)
    assert [pose.seq for pose in poses] == list(range(9000))
    assert recording.time_s(poses[50].stamp_ns) == pytest.approx(1.0)
    assert not recording.is_cut
    for copy in ("native_0 (copy).mcap", "native_old.mcap"):
        (tmp_path / copy).write_bytes((tmp_path / "native_0.mcap").read_bytes())
    assert read_recording(tmp_path) == recording


def test_what_stands_before_a_cut_is_read(tmp_path: Path) -> None:
    record(tmp_path, 3000, ended=False)
    recording = read_recording(tmp_path)
    assert len(recording.of(PoseSample)) > 1000
    assert recording.is_cut


@pytest.mark.cases(4)
@pytest.mark.parametrize("seed", range(20))
def test_what_stands_before_flipped_bits_is_read_or_the_file_is_refused(
    tmp_path: Path, seed: int
) -> None:
    record(tmp_path, 1500)
    (path,) = tmp_path.glob("native_*.mcap")
    whole = read_recording(tmp_path).of(PoseSample)
    data, random = bytearray(path.read_bytes()), Random(seed)
    for _ in range(3):
        data[random.randrange(len(data) - 200)] ^= 1 << random.randrange(8)
    path.write_bytes(data)
    found: list[PoseSample] = []
    with suppress(Refused):
        found = read_recording(tmp_path).of(PoseSample)
    assert found == whole[: len(found)]


@pytest.mark.parametrize("what", ["missing", "empty", "other"])
def test_what_is_no_recording_is_refused_in_words(tmp_path: Path, what: str) -> None:
    path = tmp_path / "run"
    if what == "empty":
        path.mkdir()
    elif what == "other":
        path.write_bytes(b"hello")
    with pytest.raises(Refused, match=r"record"):
        read_recording(path)
