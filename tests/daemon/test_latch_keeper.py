"""The latch's file is written in a thread, again and again until it is on file."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from real_robot import wait_for

from yahboomd.daemon import latch_keeper
from yahboomd.daemon.latch_file import LatchFile
from yahboomd.daemon.latch_keeper import LatchKeeper


class Disk(LatchFile):
    """A file on a disk that can be full, or hang."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.full = False
        self.room = threading.Event()
        self.room.set()
        self.entered = threading.Event()

    def _reach(self) -> None:
        self.entered.set()
        assert self.room.wait(60.0)
        if self.full:
            raise OSError(28, "No space left on device")

    def load(self) -> str | None:
        self._reach()
        return super().load()

    def engage(self, by: str) -> None:
        self._reach()
        super().engage(by)

    def release(self) -> None:
        self._reach()
        super().release()


@pytest.fixture
def disk(tmp_path: Path) -> Disk:
    return Disk(tmp_path / "estop")


@pytest.fixture
def soon(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Sets one of the waits to nearly nothing."""
    return lambda name: monkeypatch.setattr(latch_keeper, name, 0.01)


def test_pressed_again_when_there_is_room_it_is_written_at_once(
    disk: Disk, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(latch_keeper, "RETRY_S", 3600.0)
    caplog.set_level("INFO")
    keeper = LatchKeeper(disk)
    disk.full = True
    keeper.engage("one")
    wait_for(lambda: keeper.failures == 1, "the first attempt")
    keeper.engage("one")
    wait_for(lambda: keeper.failures == 2, "the second attempt")
    assert not keeper.on_file
    disk.full = False
    keeper.engage("one")
    assert keeper.settled(60.0)
    assert disk.load() == "one"
    # Once what is wrong, and once that it is over.
    assert ["cannot be written" in words for words in caplog.messages] == [True, False]
    assert "No space left on device" in caplog.text
    assert "is on file now" in caplog.text


def test_it_is_written_without_being_pressed_again_too(disk: Disk, soon) -> None:
    soon("RETRY_S")
    keeper = LatchKeeper(disk)
    disk.full = True
    keeper.engage("one")
    wait_for(lambda: keeper.failures > 2, "it is tried again")
    disk.full = False
    assert keeper.settled(60.0)
    assert disk.load() == "one"


def test_a_hung_disk_holds_nobody_up_and_no_release_is_believed(
    disk: Disk, soon, monkeypatch: pytest.MonkeyPatch
) -> None:
    soon("RELEASE_WITHIN_S")
    keeper = LatchKeeper(disk)
    keeper.engage("one")
    assert keeper.settled(60.0)
    disk.room.clear()
    disk.entered.clear()
    assert not keeper.release()
    keeper.engage("one")
    assert disk.entered.wait(60.0)
    # It hangs; waiting once was enough.
    soon_ended = threading.Event()
    monkey = threading.Thread(target=lambda: (keeper.release(), soon_ended.set()))
    monkey.start()
    monkey.join(60.0)
    assert soon_ended.is_set()
    assert not keeper.on_file
    # The removal that nobody waited for comes late, and is undone.
    disk.room.set()
    assert keeper.settled(60.0)
    assert disk.load() == "one"
    monkeypatch.setattr(latch_keeper, "RELEASE_WITHIN_S", 60.0)
    assert keeper.release()
    assert disk.load() is None


def test_a_file_that_cannot_be_read_in_time_counts_as_engaged(
    disk: Disk, soon, caplog: pytest.LogCaptureFixture
) -> None:
    soon("LOAD_WITHIN_S")
    disk.room.clear()
    assert LatchKeeper(disk).load() == "unknown (its file could not be read in time)"
    assert "counts as engaged" in caplog.text
    disk.room.set()


def test_an_error_of_ours_in_the_thread_is_a_failure_like_any_other(disk: Disk, soon) -> None:
    soon("RETRY_S")
    keeper = LatchKeeper(disk)
    broken, disk.engage = disk.engage, lambda _by: {}["missing"]  # type: ignore[method-assign]
    keeper.engage("one")
    wait_for(lambda: keeper.failures > 1, "it is tried again")
    disk.engage = broken  # type: ignore[method-assign]
    assert keeper.settled(60.0)


def test_no_thread_is_left_once_the_file_is_as_it_should_be(disk: Disk) -> None:
    keeper = LatchKeeper(disk)
    for by in ("one", "two"):
        keeper.engage(by)
        assert keeper.settled(60.0)
        assert keeper.release()
    wait_for(
        lambda: not any(each.name == "latch-file" for each in threading.enumerate()), "no thread"
    )
