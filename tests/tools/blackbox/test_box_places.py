"""Boxes are found where daemons put them, with a daemon that runs, that was killed, or without."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from made_boxes import HEADER, SECOND_NS, WALL_NS, ring_of, saved_box

from yahboomd.blackbox.records import DecisionRecord
from yahboomd.blackbox.ring_file import RingFile
from yahboomd.blackbox.saved_boxes import save_box
from yahboomd.core.errors import ConfigError
from yahboomd.tools.blackbox.box_places import Found, Places, boxes, choose, load


def filled(folder: Path) -> Places:
    saved, runs = folder / "saved", folder / "run"
    saved.mkdir()
    runs.mkdir()
    for reason in ("estop", "crash"):
        save_box(saved, saved_box(), reason=reason, wall_ns=1)
    return Places((saved,), (runs,), ())


def test_boxes_are_listed_by_their_time_and_the_running_one_last(tmp_path: Path) -> None:
    where = filled(tmp_path)
    killed, running = (RingFile(where.rings[0], HEADER) for _ in range(2))
    killed.close(keep=True)
    found = boxes(where)
    # The header of these rings has the year 2023.
    assert [each.kind for each in found] == ["left", "saved", "saved", "running"]
    assert [each.name for each in found[1:3]] == ["1", "2"]
    # A ring is read by its name, with its daemon dead or alive.
    for each in (found[0], found[3]):
        assert load(choose(found, each.name)).header == HEADER
    running.close(keep=False)


def test_the_newest_that_is_saved_is_meant_where_none_is_named(tmp_path: Path) -> None:
    where = filled(tmp_path)
    running = RingFile(where.rings[0], HEADER)
    found = boxes(where)
    assert choose(found, None).name.startswith("000002_")
    assert choose(found, "1").name.startswith("000001_")
    assert choose(found, "000001").name.startswith("000001_")
    assert choose(found[-1:], None) == found[-1].path
    file = tmp_path / "sent by mail"
    file.write_bytes(saved_box())
    assert choose(found, str(file)) == file
    running.close(keep=False)


@pytest.mark.parametrize(("seconds_ago", "name"), [(30, "7"), (10, "2")])
def test_a_stop_that_no_save_shows_yet_is_meant_before_an_older_save(
    tmp_path: Path, seconds_ago: int, name: str
) -> None:
    where = filled(tmp_path)
    ring = tmp_path / "ring"
    drives = DecisionRecord(state="driving", driver="cmd_vel", why="cmd_vel drives.")
    silent = DecisionRecord(state="stopping", driver="", why="cmd_vel fell silent.")
    ring.write_bytes(ring_of((40.0, drives), (20.0, silent)))
    for path in where.saved[0].iterdir():
        saved_ns = WALL_NS - seconds_ago * SECOND_NS
        os.utime(path, ns=(saved_ns, saved_ns))
    found = [*boxes(where), Found(ring, "7", "running", WALL_NS, 1)]
    assert choose(found, None) == choose(found, name)


def test_what_is_not_there_or_not_clear_is_refused_with_a_remedy(tmp_path: Path) -> None:
    where = filled(tmp_path)
    found = boxes(where)
    with pytest.raises(ConfigError, match="lists them"):
        choose(found, "9")
    with pytest.raises(ConfigError, match="blackbox save"):
        choose([], None)
    with pytest.raises(ConfigError, match="Name one: /"):
        choose([*found, *found], "1")
    with pytest.raises(ConfigError, match="cannot be read"):
        load(tmp_path / "missing")
    (tmp_path / "text").write_text("no box")
    with pytest.raises(ConfigError, match="no black box of yahboomd"):
        load(tmp_path / "text")
