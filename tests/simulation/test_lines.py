from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from yahboomd.simulation.lines import LinesWriter, read_lines


class Line(msgspec.Struct):
    number: int


def test_what_is_written_is_read_back_in_order(tmp_path: Path) -> None:
    writer = LinesWriter(tmp_path / "file")
    writer.open()
    for number in range(3):
        writer.write(Line(number))
        # Flushed at once by default.
        assert read_lines(tmp_path / "file", Line)[-1] == Line(number)
    writer.close()
    writer.close()
    writer.write(Line(9))
    assert read_lines(tmp_path / "file", Line) == [Line(0), Line(1), Line(2)]


def test_lines_wait_for_each_other_where_that_is_wanted(tmp_path: Path) -> None:
    writer = LinesWriter(tmp_path / "file", flush_every=3)
    writer.open()
    seen = []
    for number in range(6):
        writer.write(Line(number))
        seen.append(len(read_lines(tmp_path / "file", Line)))
    assert seen == [0, 0, 3, 3, 3, 6]
    writer.write(Line(6))
    writer.close()
    assert len(read_lines(tmp_path / "file", Line)) == 7


def test_opening_starts_an_empty_file(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("old")
    writer = LinesWriter(tmp_path / "file")
    writer.open()
    writer.close()
    assert read_lines(tmp_path / "file", Line) == []


def test_a_half_line_is_left_out_and_a_whole_one_must_be_ours(tmp_path: Path) -> None:
    (tmp_path / "file").write_text('{"number": 1}\n{"num')
    assert read_lines(tmp_path / "file", Line) == [Line(1)]
    (tmp_path / "file").write_text('{"colour": 1}\n')
    with pytest.raises(msgspec.ValidationError):
        read_lines(tmp_path / "file", Line)


def test_a_file_that_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="No such file"):
        LinesWriter(tmp_path / "nowhere" / "file").open()


def test_a_full_disk_is_named_with_the_file() -> None:
    full = Path("/dev/full")
    if not full.is_char_device():
        pytest.skip("there is no /dev/full")
    words = "No space left on device: '/dev/full'"
    writer = LinesWriter(full, flush_every=9)
    writer.open()
    writer.write(Line(0))
    with pytest.raises(OSError, match=words):
        writer.close()
    writer = LinesWriter(full)
    writer.open()
    with pytest.raises(OSError, match=words):
        writer.write(Line(0))
    with pytest.raises(OSError, match=words):
        writer.close()
