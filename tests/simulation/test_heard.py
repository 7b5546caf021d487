from __future__ import annotations

from pathlib import Path

import pytest

from yahboomd.simulation.heard import HeardWriter, HostBytes, read_heard


@pytest.fixture
def writer(tmp_path: Path) -> HeardWriter:
    writer = HeardWriter(tmp_path / "heard")
    writer.open()
    return writer


def test_every_byte_is_read_back_while_the_file_is_still_open(
    tmp_path: Path, writer: HeardWriter
) -> None:
    data = bytes(range(256))
    writer.note(data, 5)
    writer.note(b"$spd:0,0,0,0#", 7)
    first, second = read_heard(tmp_path / "heard")
    assert first.data.encode("latin-1") == data
    assert second == HostBytes(t_ns=7, data="$spd:0,0,0,0#")
    writer.close()


def test_half_a_line_is_left_out(tmp_path: Path, writer: HeardWriter) -> None:
    writer.note(b"a", 1)
    with (tmp_path / "heard").open("ab") as file:
        file.write(b'{"t_ns": 2')
    assert read_heard(tmp_path / "heard") == [HostBytes(t_ns=1, data="a")]
    writer.close()


def test_nothing_is_written_after_the_close(tmp_path: Path, writer: HeardWriter) -> None:
    writer.close()
    writer.note(b"a", 1)
    writer.close()
    assert read_heard(tmp_path / "heard") == []
