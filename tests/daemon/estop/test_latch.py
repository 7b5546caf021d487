"""The e-stop and its memory, and the thread that writes its file."""

from __future__ import annotations

import shutil
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from real_robot import wait_for

from yahboomd.core.daemon.estop import latch as latch_module
from yahboomd.core.daemon.estop.latch import EstopLatch, LatchKeeper
from yahboomd.core.daemon.estop.latch_file import LatchFile


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
    return lambda name: monkeypatch.setattr(latch_module, name, 0.01)


def test_pressed_again_when_there_is_room_it_is_written_at_once(
    disk: Disk, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(latch_module, "RETRY_S", 3600.0)
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
    # Once for the trouble, and once for its end.
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


def test_a_hung_disk_delays_nothing_and_no_release_is_believed(
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
    # The removal that is no longer awaited comes late, and is undone.
    disk.room.set()
    assert keeper.settled(60.0)
    assert disk.load() == "one"
    monkeypatch.setattr(latch_module, "RELEASE_WITHIN_S", 60.0)
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


@pytest.mark.parametrize("writable", [True, False])
def test_the_file_of_an_engaged_latch_that_was_removed_is_written_again(
    tmp_path: Path, soon, writable: bool
) -> None:
    soon("RETRY_S")
    session = tmp_path / "session"
    path = session / "yahboomd" / "estop"
    latch = EstopLatch(LatchFile(path), 0)
    latch.engage("one", 1)
    latch.remember()
    assert latch.settle()
    shutil.rmtree(session)
    if not writable:
        # No session of this user, because a file stands in its folder's place.
        session.touch()
    latch.restore_file(4_999_999_999)
    latch.restore_file(5_000_000_000)
    if not writable:
        wait_for(lambda: latch.status_values()["estop_not_on_file"], "it is noticed")
        session.unlink()
    wait_for(path.exists, "it is there again")
    assert latch.settle()
    assert LatchFile(path).load() == "one"
    assert latch.release(()).released
    latch.restore_file(10_000_000_000)
    assert not path.exists()


def test_a_latch_for_whose_file_no_thread_can_be_started_is_written_with_the_next_look(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    latch = EstopLatch(LatchFile(tmp_path / "estop"), 0)
    latch.engage("one", 1)
    latch.remember()
    assert latch.settle()
    (tmp_path / "estop").unlink()
    with monkeypatch.context() as few:

        def start(_: threading.Thread) -> None:
            raise RuntimeError("can't start new thread")

        few.setattr(threading.Thread, "start", start)
        latch.restore_file(5_000_000_000)
    latch.restore_file(10_000_000_000)
    wait_for((tmp_path / "estop").exists, "it is there again")
    assert latch.release(()).released


def test_a_press_writes_a_removed_file_again_before_it_is_acknowledged(tmp_path: Path) -> None:
    latch = EstopLatch(LatchFile(tmp_path / "estop"), 0)
    latch.engage("one", 1)
    latch.remember()
    assert latch.settle()
    (tmp_path / "estop").unlink()
    assert not latch.engage("two", 2)
    latch.remember()
    assert latch.settle()
    assert LatchFile(tmp_path / "estop").load() == "one"


async def test_a_press_for_whose_file_no_thread_can_be_started_is_acknowledged_as_not_on_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    latch = EstopLatch(LatchFile(tmp_path / "estop"), 0)
    with monkeypatch.context() as few:

        def start(_: threading.Thread) -> None:
            raise RuntimeError("can't start new thread")

        few.setattr(threading.Thread, "start", start)
        few.setattr(latch_module, "SETTLE_S", 0.05)
        assert latch.engage("one", 1)
        latch.remember()
        assert not await latch.on_file()
    latch.remember()
    assert latch.settle()
    assert (tmp_path / "estop").exists()


def test_no_thread_is_left_once_the_file_is_as_it_should_be(disk: Disk) -> None:
    keeper = LatchKeeper(disk)
    for by in ("one", "two"):
        keeper.engage(by)
        assert keeper.settled(60.0)
        assert keeper.release()
    wait_for(
        lambda: not any(each.name == "latch-file" for each in threading.enumerate()), "no thread"
    )


def test_a_remembered_latch_is_engaged_after_a_restart(tmp_path: Path) -> None:
    first = EstopLatch(LatchFile(tmp_path / "estop"), 0)
    assert first.engage("a query", 5)
    first.remember()
    assert first.settle()
    second = EstopLatch(LatchFile(tmp_path / "estop"), 10)
    assert second.engaged
    assert second.latched is not None
    assert second.latched.by == "a query"


def test_a_remembered_latch_is_logged_with_its_remedy(
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
    assert latch.status_values() == {"estop_not_on_file": 0, "estop_file_failures": 0}
    latch.engage("one", 1)
    latch.remember()
    assert latch.latched is not None
    assert latch.latched.reason.endswith("(not on file: it would not survive a restart)")
    assert latch.status_values()["estop_not_on_file"] == 1
    let_go.set()
    assert latch.settle()
    assert "not on file" not in latch.latched.reason
    assert latch.status_values()["estop_not_on_file"] == 0


def test_a_file_that_is_removed_too_late_is_written_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    let_go = threading.Event()
    release = LatchFile.release
    monkeypatch.setattr(LatchFile, "release", lambda self: let_go.wait(60.0) and release(self))
    monkeypatch.setattr(latch_module, "RELEASE_WITHIN_S", 0.01)
    latch = EstopLatch(LatchFile(tmp_path / "estop"), 0)
    latch.engage("one", 1)
    latch.remember()
    assert latch.settle()
    assert not latch.release(()).released
    assert latch.engaged
    let_go.set()
    wait_for(lambda: latch.status_values()["estop_not_on_file"] == 0, "it is on file")
    assert EstopLatch(LatchFile(tmp_path / "estop"), 2).engaged


@pytest.mark.nightly
def test_with_all_descriptors_taken_it_is_answered_that_the_latch_is_not_on_file(
    tmp_path: Path,
) -> None:
    script = """
import asyncio, os, resource, sys
from pathlib import Path
from yahboomd.core.daemon.estop.latch import EstopLatch
from yahboomd.core.daemon.estop.latch_file import LatchFile

async def main():
    latch = EstopLatch(LatchFile(Path(sys.argv[1])), 0)
    resource.setrlimit(resource.RLIMIT_NOFILE, (3, 3))
    latch.engage("a test", 0)
    latch.remember()
    print(await latch.on_file())

asyncio.run(main())
"""
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path / "estop")],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.stdout == "False\n"
