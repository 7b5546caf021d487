"""A board's values are on the disk before they are changed, whole, until they are restored."""

from __future__ import annotations

import os
import resource
from pathlib import Path

import msgspec
import pytest
from tuning_bench import configured

from yahboomd.core.errors import Refused
from yahboomd.tools.tune import saved
from yahboomd.tools.tune.saved import (
    SavedSettings,
    check_place,
    read_saved,
    save,
    saved_path,
)

FIRST = SavedSettings(
    made="2026-05-04 10:00:00",
    port="/dev/ttyUSB0",
    dialect="streamed",
    settings={"pid": (0.8, 0.06, 0.5), "deadzone": 1600},
)
SECOND = msgspec.structs.replace(FIRST, made="later", settings={"pid": (1.0, 0.1, 0.0)})


def test_what_is_saved_is_read_again(tmp_path):
    path = tmp_path / "state" / "board.json"
    assert read_saved(path) is None
    assert save(path, FIRST) is FIRST
    found = read_saved(path)
    assert found == FIRST
    assert saved.settings_of(found) == {"pid": (0.8, 0.06, 0.5), "deadzone": 1600}


def test_a_tuning_that_was_killed_leaves_what_the_next_one_keeps(tmp_path):
    path = tmp_path / "board.json"
    save(path, FIRST)
    assert save(path, SECOND) == FIRST
    assert read_saved(path) == FIRST


def test_the_disk_has_the_file_and_its_name_before_it_returns(tmp_path, monkeypatch):
    done = []
    monkeypatch.setattr(os, "fsync", lambda fd: done.append(os.readlink(f"/proc/self/fd/{fd}")))
    replace = os.replace
    monkeypatch.setattr(os, "replace", lambda old, new: (done.append("replace"), replace(old, new)))
    save(tmp_path / "board.json", FIRST)
    made, *then = done
    assert made.startswith(f"{tmp_path}/.board.json.")
    assert then == ["replace", str(tmp_path)]


def test_where_the_disk_does_not_take_it_the_board_is_left_alone():
    with pytest.raises(Refused, match="The board was not changed"):
        save(Path("/proc/nowhere/board.json"), FIRST)


def test_a_check_leaves_no_file(tmp_path):
    path = tmp_path / "state" / "board.json"
    check_place(path, "/dev/ttyUSB0")
    assert list(path.parent.iterdir()) == []
    save(path, FIRST)
    check_place(path, "/dev/ttyUSB0")
    assert read_saved(path) == FIRST


@pytest.mark.parametrize("room", [0, 20])
def test_a_check_finds_a_full_disk(tmp_path, room):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, limits[1]))
    try:
        with pytest.raises(Refused, match=r"board\.json cannot be written: File too large\."):
            check_place(tmp_path / "board.json", "/dev/ttyUSB0")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def test_a_file_of_something_else_is_named(tmp_path):
    (tmp_path / "board.json").write_text("[1]")
    with pytest.raises(Refused, match="has no settings of a board"):
        read_saved(tmp_path / "board.json")


def test_each_robot_of_a_machine_has_a_file_of_its_own(tmp_path):
    environ = {"STATE_DIRECTORY": str(tmp_path)}
    plain = saved_path(configured("520"), environ, None)
    named = saved_path(configured("520", "zenoh.namespace=bot1"), environ, None)
    ported = saved_path(configured("520", "serial.port=/dev/ttyUSB1"), environ, None)
    assert plain.parent == tmp_path
    assert len({plain, named, ported}) == 3
    assert "/" not in ported.name
