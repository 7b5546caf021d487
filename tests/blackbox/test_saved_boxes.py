"""The folder of saved boxes: whole files, bounded, the first and the newest kept."""

from __future__ import annotations

import errno
import os
import stat

import pytest

from yahboomd.blackbox import saved_boxes as room
from yahboomd.blackbox.saved_boxes import BYTES_MOST, FILES_MOST, save_box, saved_boxes

WALL_NS = 1_795_370_130_000_000_000


def save(folder, data=b"box", reason="estop", wall_ns=WALL_NS):
    return save_box(folder, data, reason=reason, wall_ns=wall_ns)


def numbers(folder):
    return [box.number for box in saved_boxes(folder)]


def test_a_box_is_named_by_number_time_and_reason_and_is_for_the_group(tmp_path):
    path = save(tmp_path)
    assert path.name == "000001_20261122T175530Z_estop.blackbox"
    assert path.read_bytes() == b"box"
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert (path.stat().st_uid, path.stat().st_gid) == (os.geteuid(), os.getegid())
    assert save(tmp_path, reason="runaway").name.startswith("000002_")
    assert [each.name for each in tmp_path.iterdir() if each.name.startswith(".")] == []


def test_the_first_and_the_newest_are_kept(tmp_path):
    for _ in range(FILES_MOST + 15):
        save(tmp_path)
    found = numbers(tmp_path)
    assert len(found) == FILES_MOST
    assert found == [1, *range(17, FILES_MOST + 16)]


def test_they_are_bounded_in_bytes(tmp_path):
    size = BYTES_MOST // 5
    for number in range(9):
        save(tmp_path, bytes([number]) * size)
    boxes = saved_boxes(tmp_path)
    assert sum(box.size for box in boxes) <= BYTES_MOST
    assert [box.number for box in boxes] == [1, 6, 7, 8, 9]


def test_a_number_is_used_once_however_the_clock_is_set(tmp_path):
    first = save(tmp_path, wall_ns=WALL_NS)
    second = save(tmp_path, wall_ns=0)
    assert first.name < second.name
    assert "19700101" in second.name


@pytest.mark.parametrize("at", ["fsync", "link"])
def test_a_disk_that_fills_up_leaves_nothing_of_a_box(tmp_path, monkeypatch, at):
    def full(*_arguments):
        raise OSError(errno.ENOSPC, "No space left on device")

    save(tmp_path)
    monkeypatch.setattr(os, at, full)
    with pytest.raises(OSError, match="No space"):
        save(tmp_path)
    assert len(list(tmp_path.iterdir())) == 1


def test_the_last_megabytes_of_a_disk_are_left_to_others(tmp_path, monkeypatch):
    monkeypatch.setattr(room, "ROOM_BYTES", 1 << 60)
    with pytest.raises(OSError, match="free") as refused:
        save(tmp_path)
    assert refused.value.errno == errno.ENOSPC
    assert list(tmp_path.iterdir()) == []


def test_what_a_killed_daemon_left_half_written_goes_after_a_while(tmp_path):
    old, new = tmp_path / ".1.blackbox.a", tmp_path / ".2.blackbox.b"
    for path, age_s in ((old, 3600), (new, 1)):
        path.write_bytes(b"half")
        os.utime(path, (WALL_NS / 1e9 - age_s,) * 2)
    save(tmp_path)
    assert not old.exists()
    assert new.exists()


def test_other_files_are_neither_counted_nor_removed(tmp_path):
    other = tmp_path / "my notes.txt"
    other.write_text("x" * 100)
    for _ in range(FILES_MOST + 2):
        save(tmp_path)
    assert other.exists()
    assert saved_boxes(tmp_path / "missing") == []


def test_the_robot_stands_in_the_name_and_boxes_without_it_are_still_counted(tmp_path):
    save(tmp_path, b"old")
    path = save_box(tmp_path, b"new", reason="estop", wall_ns=10**18, robot="bot1-ttyUSB0")
    assert path.name == "000002_20010909T014640Z_estop.bot1-ttyUSB0.blackbox"
    assert [box.number for box in saved_boxes(tmp_path)] == [1, 2]
