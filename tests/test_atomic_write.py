"""A file is replaced in one step, or stays as it was."""

from __future__ import annotations

from pathlib import Path

import pytest

from yahboomd.core.atomic_write import write_atomic


def test_a_file_is_written_with_its_mode_and_nothing_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    write_atomic(path, b"one")
    write_atomic(path, b"two", mode=0o600)
    assert path.read_bytes() == b"two"
    assert path.stat().st_mode & 0o777 == 0o600
    assert [each.name for each in tmp_path.iterdir()] == ["a.toml"]


def test_a_link_is_replaced_and_not_followed(tmp_path: Path) -> None:
    (tmp_path / "other").write_text("theirs")
    (tmp_path / "a.toml").symlink_to(tmp_path / "other")
    write_atomic(tmp_path / "a.toml", b"ours")
    assert (tmp_path / "other").read_text() == "theirs"
    assert not (tmp_path / "a.toml").is_symlink()


def test_a_file_that_fails_its_check_or_is_there_already_leaves_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text("old")

    def refuse(made: Path) -> None:
        assert made.read_bytes() == b"new"
        raise ValueError

    with pytest.raises(ValueError):  # noqa: PT011 - it is the check's own
        write_atomic(path, b"new", check=refuse)
    with pytest.raises(FileExistsError):
        write_atomic(path, b"new", replace=False)
    assert path.read_text() == "old"
    assert [each.name for each in tmp_path.iterdir()] == ["a.toml"]
