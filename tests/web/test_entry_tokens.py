"""Links that let one phone in, once."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from web_site import full_disk

from yahboomd.core.errors import ConfigError
from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time
from yahboomd.web.session_files import (
    LINK_NS,
    EntryLink,
    digest,
    forget_links,
    keep,
    link_of,
    make_entry,
    read_private,
    since_boot_ns,
    use_up,
)


@on_virtual_time
async def test_a_link_is_for_this_user_alone_and_its_file_does_not_have_its_token(
    tmp_path: Path,
) -> None:
    folder, clock = tmp_path / "state", LoopClock()
    token = make_entry(folder, "driver", clock)
    (path,) = folder.iterdir()
    assert path.stat().st_mode & 0o777 == 0o600
    assert folder.stat().st_mode & 0o777 == 0o700
    # 128 bits.
    assert len(token) == 22
    assert token not in path.name + path.read_text()
    assert make_entry(folder, "driver", clock) != token


@on_virtual_time
async def test_a_link_has_its_role_and_is_used_up_once(tmp_path: Path) -> None:
    clock = LoopClock()
    driver, viewer = (make_entry(tmp_path, role, clock) for role in ("driver", "viewer"))
    now_ns = since_boot_ns(clock)
    assert link_of(tmp_path, driver, now_ns) == EntryLink(role="driver", made_ns=now_ns)
    assert link_of(tmp_path, viewer, now_ns) == EntryLink(role="viewer", made_ns=now_ns)
    for wrong in ("", driver[:-1], driver.swapcase(), "\u00e9", "\ud800", "../../x", "\0"):
        assert link_of(tmp_path, wrong, now_ns) == "unknown"
        assert not use_up(tmp_path, wrong)
    assert [use_up(tmp_path, driver) for _ in range(3)] == [True, False, False]
    assert link_of(tmp_path, driver, now_ns) == "unknown"
    assert isinstance(link_of(tmp_path, viewer, now_ns), EntryLink)


@on_virtual_time
async def test_a_link_gets_old_by_the_clock_that_no_correction_changes(tmp_path: Path) -> None:
    clock = LoopClock()
    token = make_entry(tmp_path, "driver", clock)
    made_ns = since_boot_ns(clock)
    # The time of day jumps by years, forwards and back; that of the file, too.
    (path,) = tmp_path.iterdir()
    for year_ns in (0, 1 << 60):
        os.utime(path, ns=(year_ns, year_ns))
        assert isinstance(link_of(tmp_path, token, made_ns + LINK_NS), EntryLink)
    assert link_of(tmp_path, token, made_ns + LINK_NS + 1) == "old"
    # A suspended machine ages it as well.
    clock.slept_ns = LINK_NS + 1
    assert link_of(tmp_path, token, since_boot_ns(clock)) == "old"
    # One of another boot.
    assert link_of(tmp_path, token, made_ns - 1) == "old"


@on_virtual_time
async def test_links_that_ended_are_removed_when_others_are_made(tmp_path: Path) -> None:
    clock = LoopClock()
    old = make_entry(tmp_path, "driver", clock)
    clock.slept_ns = LINK_NS + 1
    fresh = make_entry(tmp_path, "viewer", clock)
    assert len(list(tmp_path.iterdir())) == 1
    assert link_of(tmp_path, old, since_boot_ns(clock)) == "unknown"
    assert forget_links(tmp_path, since_boot_ns(clock)) == 0
    assert forget_links(tmp_path) == 1
    assert link_of(tmp_path, fresh, since_boot_ns(clock)) == "unknown"


@on_virtual_time
async def test_a_file_that_others_may_read_or_that_is_no_link_lets_nobody_in(
    tmp_path: Path,
) -> None:
    clock = LoopClock()
    token = make_entry(tmp_path, "driver", clock)
    (path,) = tmp_path.iterdir()
    now_ns = since_boot_ns(clock)
    for mode in (0o644, 0o620, 0o602):
        path.chmod(mode)
        assert link_of(tmp_path, token, now_ns) == "unknown"
    path.chmod(0o600)
    assert isinstance(link_of(tmp_path, token, now_ns), EntryLink)
    good = path.read_bytes()
    for content in (b"", b"{", b"[" * 4000, good.replace(b"driver", b"admin")):
        path.write_bytes(content)
        assert link_of(tmp_path, token, now_ns) == "unknown"
    elsewhere = tmp_path / "elsewhere"
    elsewhere.write_bytes(good)
    elsewhere.chmod(0o600)
    path.unlink()
    path.symlink_to(elsewhere)
    assert read_private(path, EntryLink) is None
    path.unlink()
    # A pipe does not block whoever reads it.
    os.mkfifo(path, 0o600)
    assert read_private(path, EntryLink) is None


def test_it_replaces_links_and_never_writes_through_them(tmp_path: Path) -> None:
    precious = tmp_path / "precious"
    precious.write_text("precious")
    (tmp_path / "file").symlink_to(precious)
    keep(tmp_path, "file", b"new")
    assert precious.read_text() == "precious"
    assert (tmp_path / "file").read_bytes() == b"new"


@on_virtual_time
async def test_on_a_full_disk_no_link_is_made_and_nothing_stays_behind(tmp_path: Path) -> None:
    with full_disk(), pytest.raises(ConfigError, match=r"No link can be made.*make room"):
        make_entry(tmp_path, "driver", LoopClock())
    assert list(tmp_path.iterdir()) == []


@on_virtual_time
async def test_a_file_in_the_place_of_the_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "state").write_text("")
    with pytest.raises(ConfigError, match=r"No link can be made in .*--show-link"):
        make_entry(tmp_path / "state", "driver", LoopClock())


def test_a_digest_takes_any_text() -> None:
    assert len({digest(text) for text in ("", "a", "\ud800", "\u00e9")}) == 4
