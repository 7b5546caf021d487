"""The e-stop and its memory together."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
from real_robot import wait_for

from yahboomd.daemon import latch_keeper
from yahboomd.daemon.latch import EstopLatch
from yahboomd.daemon.latch_file import LatchFile


def test_a_remembered_latch_is_engaged_after_a_restart(tmp_path: Path) -> None:
    first = EstopLatch(LatchFile(tmp_path / "estop"), 0)
    assert first.engage("a query", 5)
    first.remember()
    assert first.settle()
    second = EstopLatch(LatchFile(tmp_path / "estop"), 10)
    assert second.engaged
    assert second.latched is not None
    assert second.latched.by == "a query"


def test_a_remembered_latch_is_told_in_the_log_with_its_remedy(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = tmp_path / "estop"
    first = EstopLatch(LatchFile(file), 0)
    assert not caplog.messages
    first.engage("a query", 5)
    first.remember()
    assert first.settle()
    EstopLatch(LatchFile(file), 10)
    (words,) = caplog.messages
    assert "by a query" in words
    assert "yahboomd stop --release" in words


def test_engaging_twice_is_news_once(tmp_path: Path) -> None:
    latch = EstopLatch(LatchFile(tmp_path / "estop"), 0)
    assert latch.engage("one", 1)
    assert not latch.engage("two", 2)
    assert latch.latched is not None
    assert latch.latched.by == "one"


def test_a_release_forgets_the_file(tmp_path: Path) -> None:
    latch = EstopLatch(LatchFile(tmp_path / "estop"), 0)
    latch.engage("one", 1)
    latch.remember()
    assert latch.release(()).released
    assert latch.settle()
    assert not EstopLatch(LatchFile(tmp_path / "estop"), 2).engaged


def test_a_file_that_cannot_be_removed_keeps_the_latch_engaged(tmp_path: Path) -> None:
    latch = EstopLatch(LatchFile(tmp_path / "estop"), 0)
    # A folder in the file's place cannot be unlinked.
    (tmp_path / "estop").mkdir()
    latch.engage("one", 1)
    latch.remember()
    assert not latch.release(()).released
    assert latch.engaged


async def test_an_older_name_counts_as_engaged_and_so_does_the_new_one_from_then_on(
    tmp_path: Path,
) -> None:
    LatchFile(tmp_path / "estop").engage("a query")
    path = tmp_path / "estop@%2Fdev%2FttyUSB0"
    latch = EstopLatch(LatchFile(path, port="/dev/ttyUSB0"), 0)
    assert latch.engaged
    assert await latch.on_file()
    assert path.exists()
    assert latch.release(()).released
    assert list(tmp_path.iterdir()) == []


def test_what_is_not_on_file_is_said_in_the_status(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    let_go = threading.Event()
    engage = LatchFile.engage
    monkeypatch.setattr(
        LatchFile, "engage", lambda self, by: let_go.wait(60.0) and engage(self, by)
    )
    latch = EstopLatch(LatchFile(tmp_path / "estop"), 0)
    assert latch.facts() == {"estop_not_on_file": 0, "estop_file_failures": 0}
    latch.engage("one", 1)
    latch.remember()
    assert latch.latched is not None
    assert latch.latched.reason.endswith("(not on file: it would not survive a restart)")
    assert latch.facts()["estop_not_on_file"] == 1
    let_go.set()
    assert latch.settle()
    assert "not on file" not in latch.latched.reason
    assert latch.facts()["estop_not_on_file"] == 0


def test_a_file_that_is_removed_too_late_is_written_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    let_go = threading.Event()
    release = LatchFile.release
    monkeypatch.setattr(LatchFile, "release", lambda self: let_go.wait(60.0) and release(self))
    monkeypatch.setattr(latch_keeper, "RELEASE_WITHIN_S", 0.01)
    latch = EstopLatch(LatchFile(tmp_path / "estop"), 0)
    latch.engage("one", 1)
    latch.remember()
    assert latch.settle()
    assert not latch.release(()).released
    assert latch.engaged
    let_go.set()
    wait_for(lambda: latch.facts()["estop_not_on_file"] == 0, "it is on file")
    assert EstopLatch(LatchFile(tmp_path / "estop"), 2).engaged
