"""The files of sessions."""

from __future__ import annotations

import os
from pathlib import Path

import msgspec
import pytest
from web_site import full_disk

from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time
from yahboomd.web.session_files import (
    PREFIX,
    StoredSession,
    claim,
    end_stored,
    keep,
    link_of,
    make_entry,
    read_stored,
    replace,
    since_boot_ns,
    stored_sessions,
    touch,
)

ANNE = StoredSession(role="driver", name="Anne", key="0" * 64, made_s=1)


def store(folder: Path, number: str = "3f9a2c") -> Path:
    keep(folder, f"{PREFIX}{number}", msgspec.json.encode(ANNE))
    return folder / f"{PREFIX}{number}"


def test_sessions_are_listed_with_their_last_use_and_removed_once(tmp_path: Path) -> None:
    path = store(tmp_path)
    assert path.stat().st_mode & 0o777 == 0o600
    os.utime(path, ns=(5, 5))
    (tmp_path / f"{PREFIX}broken").write_text("{")
    (tmp_path / f"{PREFIX}link").symlink_to(path)
    assert list(stored_sessions(tmp_path)) == [("3f9a2c", ANNE, 5)]
    assert end_stored(tmp_path, "3f9a2c")
    assert not end_stored(tmp_path, "3f9a2c")
    assert list(stored_sessions(tmp_path / "nothing")) == []


def test_a_session_that_other_users_may_read_is_none(tmp_path: Path) -> None:
    path = store(tmp_path)
    assert read_stored(path) is not None
    path.chmod(0o604)
    assert read_stored(path) is None


@pytest.mark.parametrize("number", ["", "3f9a2", "3f9a2cc", "3F9A2C", "\udcff<b>", "3f9a2c\n"])
def test_a_file_without_a_number_in_its_name_is_no_session(tmp_path: Path, number: str) -> None:
    """One of them left no phone in the list, because no answer could have its name."""
    assert read_stored(store(tmp_path, number)) is None
    assert list(stored_sessions(tmp_path)) == []


@pytest.mark.parametrize("key", ["", "0" * 63, "\xe9" * 64, "0" * 64 + "\n"])
def test_a_file_without_a_hash_is_no_session(tmp_path: Path, key: str) -> None:
    """Text that is not ASCII cannot be compared with a cookie's hash."""
    stored = msgspec.structs.replace(ANNE, key=key)
    keep(tmp_path, f"{PREFIX}3f9a2c", msgspec.json.encode(stored))
    assert read_stored(tmp_path / f"{PREFIX}3f9a2c") is None


def test_the_last_use_never_goes_back(tmp_path: Path) -> None:
    """A computer without a battery for its clock starts in the past."""
    path = store(tmp_path)
    for wall_ns, kept_ns in ((2_000, 2_000), (1_000, 2_000), (3_000, 3_000)):
        if wall_ns == 2_000:
            os.utime(path, ns=(1_500, 1_500))
        touch(path, wall_ns)
        assert path.stat().st_mtime_ns == kept_ns
    touch(tmp_path / "nothing", 1)
    assert not (tmp_path / "nothing").exists()


@on_virtual_time
async def test_a_link_becomes_one_session_and_a_full_disk_costs_no_link(tmp_path: Path) -> None:
    clock = LoopClock()
    token = make_entry(tmp_path, "driver", clock)
    with full_disk(), pytest.raises(OSError, match="File too large"):
        claim(tmp_path, token, "000001", ANNE, 5)
    assert [each.name[: len(PREFIX)] for each in tmp_path.iterdir()] != [PREFIX]
    assert not isinstance(link_of(tmp_path, token, since_boot_ns(clock)), str)
    assert claim(tmp_path, token, "000002", ANNE, 5)
    assert not claim(tmp_path, token, "000003", ANNE, 5)
    assert list(stored_sessions(tmp_path)) == [("000002", ANNE, 5)]
    assert [each.name for each in tmp_path.iterdir()] == [f"{PREFIX}000002"]


def test_a_new_name_does_not_bring_an_ended_session_back(tmp_path: Path) -> None:
    store(tmp_path)
    bert = msgspec.structs.replace(ANNE, name="Bert")
    replace(tmp_path, "3f9a2c", bert)
    with full_disk(), pytest.raises(OSError, match="File too large"):
        replace(tmp_path, "3f9a2c", ANNE)
    assert [stored for _, stored, _ in stored_sessions(tmp_path)] == [bert]
    end_stored(tmp_path, "3f9a2c")
    with pytest.raises(FileNotFoundError):
        replace(tmp_path, "3f9a2c", ANNE)
    assert list(tmp_path.iterdir()) == []
