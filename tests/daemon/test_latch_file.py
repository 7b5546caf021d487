"""The e-stop's file."""

from __future__ import annotations

from pathlib import Path

import pytest

from yahboomd.daemon.latch_file import LatchFile


def test_an_engaged_latch_is_remembered_with_who_engaged_it(tmp_path: Path) -> None:
    path = tmp_path / "run" / "estop"
    assert LatchFile(path).engage("a query")
    assert LatchFile(path).load() == "a query"


def test_a_released_latch_is_forgotten(tmp_path: Path) -> None:
    file = LatchFile(tmp_path / "estop")
    file.engage("a query")
    assert file.release()
    assert file.load() is None
    assert file.release()


def test_without_a_file_nothing_is_engaged(tmp_path: Path) -> None:
    assert LatchFile(tmp_path / "estop").load() is None


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"\xff\xfe", b'{"engaged": true}'])
def test_a_damaged_file_counts_as_engaged(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "estop"
    path.write_bytes(content)
    assert LatchFile(path).load() is not None


def test_a_folder_that_cannot_be_written_is_told_and_raises_nothing(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").touch()
    assert not LatchFile(tmp_path / "file" / "estop").engage("a query")
    assert "would not survive a restart" in caplog.text


def test_no_half_written_file_is_left_behind(tmp_path: Path) -> None:
    LatchFile(tmp_path / "estop").engage("a query")
    assert [path.name for path in tmp_path.iterdir()] == ["estop"]
