from __future__ import annotations

import os
from pathlib import Path

import pytest

from yahboomd.core.errors import ConfigError
from yahboomd.simulation.port_link import claim, point, unpoint


def test_a_link_is_made_turned_and_removed_by_the_one_whose_it_is(tmp_path: Path) -> None:
    link = tmp_path / "board"
    point(link, "/dev/pts/1")
    point(link, "/dev/pts/2")
    assert str(link.readlink()) == "/dev/pts/2"
    unpoint(link, "/dev/pts/1")
    assert str(link.readlink()) == "/dev/pts/2"
    unpoint(link, "/dev/pts/2")
    assert os.listdir(tmp_path) == []


def test_a_link_is_reserved_by_one_at_a_time(tmp_path: Path) -> None:
    link = tmp_path / "board"
    with claim(link), pytest.raises(ConfigError, match=r"replayed board runs behind .*board"):
        claim(link)
    claim(link).close()


def test_what_is_no_link_stays_and_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("precious")
    with pytest.raises(ConfigError, match="is not a link"):
        point(file, "/dev/pts/1")
    assert file.read_text() == "precious"
    with pytest.raises(ConfigError, match=r"/nowhere/board cannot be made: No such file"):
        point(Path("/nowhere/board"), "/dev/pts/1")
