"""Boxes are written by a thread, one at a time, and rings that were left behind are made boxes."""

from __future__ import annotations

import asyncio
import logging
import os
import threading
from pathlib import Path

import pytest
from msgspec import structs

from yahboomd.blackbox.box_file import Saved, read_box
from yahboomd.blackbox.box_keeper import header
from yahboomd.blackbox.box_writer import BoxOutcome, BoxWriter
from yahboomd.blackbox.records import Ended, encode
from yahboomd.blackbox.ring_file import RingFile, rings
from yahboomd.core.clock import SystemClock
from yahboomd.core.config import read

CLOCK = SystemClock()
HEADER = header(read(None, environ={}, overrides=[]).config, CLOCK)
SAVED = structs.replace(
    HEADER, saved=Saved(reasons=("estop", "disconnected"), at_ns=5, wall_ns=1_790_000_000 * 10**9)
)


async def outcome_of(start) -> BoxOutcome:
    done: asyncio.Future[BoxOutcome] = asyncio.get_running_loop().create_future()
    start(done.set_result)
    return await done


async def test_a_box_is_written_whole_and_named_by_its_first_reason(tmp_path: Path) -> None:
    writer = BoxWriter(tmp_path / "new" / "boxes", tmp_path, CLOCK)
    found = await outcome_of(lambda done: writer.save(SAVED, bytes(HEADER.segment_bytes), done))
    assert found.path is not None
    assert found.path.name.endswith("_estop.blackbox")
    assert read_box(found.path.read_bytes()).header == SAVED
    assert (writer.saved, writer.failures, writer.busy) == (1, 0, False)


async def test_its_thread_goes_behind_a_preferred_daemon_and_is_not_starved() -> None:
    """It holds the interpreter now and then, which the loop waits for."""
    writer, seen = BoxWriter(None, Path(), CLOCK), list[int]()
    own = os.getpriority(os.PRIO_PROCESS, 0)
    done = asyncio.Event()

    def job() -> int:
        return os.getpriority(os.PRIO_PROCESS, threading.get_native_id())

    def ended(nice: int) -> None:
        seen.append(nice)
        done.set()

    writer._start(job, ended, lambda _: 0)
    await done.wait()
    assert seen == [max(0, own)]


async def test_without_a_state_directory_it_says_so(tmp_path: Path) -> None:
    writer = BoxWriter(None, tmp_path, CLOCK)
    found = await outcome_of(lambda done: writer.save(SAVED, b"", done))
    assert found.path is None
    assert "blackbox.folder" in found.problem
    assert (writer.saved, writer.failures) == (0, 1)


async def test_a_folder_that_others_control_is_not_used(tmp_path: Path) -> None:
    folder = tmp_path / "boxes"
    folder.mkdir()
    os.chmod(folder, 0o777)
    writer = BoxWriter(folder, tmp_path, CLOCK)
    found = await outcome_of(lambda done: writer.save(SAVED, b"", done))
    assert found.path is None
    assert list(folder.iterdir()) == []


async def test_a_ring_that_was_left_becomes_a_box_and_goes(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "yahboomd")
    file = RingFile(tmp_path, HEADER)
    file.ring.write(2, b"$MAll:1,2,3,4#\r\n", 7)
    file.close(keep=True)
    writer = BoxWriter(tmp_path / "boxes", tmp_path, CLOCK)
    await outcome_of(writer.find_rings)
    assert writer.left == 1
    found = await outcome_of(writer.adopt)
    assert found.path is not None
    assert "An earlier daemon's black box was saved (killed)" in caplog.text
    box = read_box(found.path.read_bytes())
    assert box.header.saved is not None
    assert (box.header.saved.reasons, box.header.saved.at_ns) == (("killed",), 0)
    assert [each.at_ns for each in box.records] == [7]
    assert rings(tmp_path) == []
    assert writer.left == 0


async def test_a_ring_that_cannot_be_saved_stays_and_one_that_is_none_goes(tmp_path: Path) -> None:
    RingFile(tmp_path, HEADER).close(keep=True)
    writer = BoxWriter(None, tmp_path, CLOCK)
    assert (await outcome_of(writer.adopt)).path is None
    (ring,) = rings(tmp_path)
    ring.write_bytes(b"no ring")
    assert (await outcome_of(writer.adopt)).path is None
    assert rings(tmp_path) == []


async def test_a_job_that_raises_is_counted_and_the_next_box_is_written(tmp_path: Path) -> None:
    writer = BoxWriter(tmp_path / "boxes", tmp_path, CLOCK)
    unnamed = structs.replace(HEADER, saved=Saved(reasons=(), at_ns=5, wall_ns=5))
    found = await outcome_of(lambda done: writer.save(unnamed, b"", done))
    assert found.path is None
    assert "IndexError" in found.problem
    assert (writer.failures, writer.busy, writer.works) == (1, False, False)
    found = await outcome_of(lambda done: writer.save(SAVED, b"", done))
    assert found.path is not None
    assert writer.works


async def test_reasons_of_a_damaged_ring_name_no_other_folder(tmp_path: Path) -> None:
    file = RingFile(tmp_path, HEADER)
    file.ring.write(*encode(Ended(reasons=("../../x",))), 7)
    file.close(keep=True)
    writer = BoxWriter(tmp_path / "boxes", tmp_path, CLOCK)
    found = await outcome_of(writer.adopt)
    assert found.path is not None
    assert found.path.parent == tmp_path / "boxes"
    assert found.path.name.endswith("_killed.blackbox")
