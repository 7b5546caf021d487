"""The e-stop and its memory together."""

from __future__ import annotations

from pathlib import Path

import pytest

from yahboomd.daemon.latch import EstopLatch
from yahboomd.daemon.latch_file import LatchFile


def test_a_remembered_latch_is_engaged_after_a_restart(tmp_path: Path) -> None:
    first = EstopLatch(LatchFile(tmp_path / "estop"), 0)
    assert first.engage("a query", 5)
    first.remember()
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
    assert not EstopLatch(LatchFile(tmp_path / "estop"), 2).engaged


def test_a_file_that_cannot_be_removed_keeps_the_latch_engaged(tmp_path: Path) -> None:
    latch = EstopLatch(LatchFile(tmp_path / "estop"), 0)
    latch.engage("one", 1)
    # A folder in the file's place cannot be unlinked.
    (tmp_path / "estop").mkdir()
    assert not latch.release(()).released
    assert latch.engaged
