"""Folders in which others could remove a file are refused."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from yahboomd.core.daemon.estop.latch_file import LatchFile
from yahboomd.core.daemon.folder import check_folder, prepare_folder


@pytest.fixture
def shared(tmp_path: Path) -> Path:
    """A folder like /tmp: every user may make entries in it."""
    folder = tmp_path / "shared"
    folder.mkdir()
    folder.chmod(0o1777)
    return folder


def test_a_missing_folder_is_made_for_its_owner_and_group(tmp_path: Path) -> None:
    prepare_folder(tmp_path / "run" / "yahboomd")
    assert not (tmp_path / "run" / "yahboomd").stat().st_mode & stat.S_IRWXO


def test_a_folder_below_one_that_all_may_write_must_not_be_a_link(shared: Path) -> None:
    (shared / "elsewhere").mkdir(0o700)
    (shared / "yahboomd-0").symlink_to(shared / "elsewhere")
    with pytest.raises(PermissionError, match=r"is no folder but a link.*estop.latch_file = "):
        prepare_folder(shared / "yahboomd-0")


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can make another user's folder")
def test_another_users_folder_below_one_that_all_may_write_is_refused(shared: Path) -> None:
    (shared / "yahboomd-0").mkdir(0o700)
    os.chown(shared / "yahboomd-0", 4321, 4321)
    with pytest.raises(PermissionError, match="belongs to the user 4321"):
        prepare_folder(shared / "yahboomd-0")


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can make another user's folder")
@pytest.mark.parametrize("linked", [False, True])
def test_another_users_folder_is_refused_though_no_other_user_may_write_its_parent(
    tmp_path: Path, linked: bool
) -> None:
    folder = tmp_path / "theirs"
    folder.mkdir(0o755)
    os.chown(folder, 1234, 1234)
    if linked:
        folder = tmp_path / "link"
        folder.symlink_to("theirs")
    with pytest.raises(PermissionError, match=r"belongs to the user 1234.*estop.latch_file = "):
        prepare_folder(folder)
    assert LatchFile(folder / "estop").load() == "unknown (its folder cannot be used)"


def test_an_own_folder_that_was_made_too_open_is_closed(shared: Path) -> None:
    (shared / "yahboomd-0").mkdir()
    (shared / "yahboomd-0").chmod(0o775)
    check_folder(shared / "yahboomd-0")
    assert stat.S_IMODE((shared / "yahboomd-0").stat().st_mode) == 0o700


def test_a_folder_from_which_all_may_remove_files_is_refused(tmp_path: Path) -> None:
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    with pytest.raises(PermissionError, match="lets every user remove files"):
        check_folder(tmp_path / "open")


def test_the_group_of_a_folder_that_a_person_chose_is_that_persons_matter(tmp_path: Path) -> None:
    (tmp_path / "ours").mkdir()
    (tmp_path / "ours").chmod(0o775)
    check_folder(tmp_path / "ours")
