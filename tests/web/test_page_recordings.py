"""Recordings of pages: bounded, listed, removed on purpose, and never outside of their folder."""

from __future__ import annotations

import asyncio
import json
import shutil
from collections.abc import Awaitable, Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from real_robot import RealRobot
from web_site import Page, Site
from zenoh_fixtures import eventually

from yahboomd.core.clock import SystemClock
from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time
from yahboomd.web import page_recordings
from yahboomd.web.page_recordings import ALONE_S, PageRecordings


def made(folder: Path) -> PageRecordings:
    return PageRecordings(SystemClock(), ["--connect=tcp/127.0.0.1:1"], folder, lambda: None)


def recording(folder: Path, name: str, size: int = 1000) -> Path:
    (folder / name).mkdir(parents=True)
    (folder / name / "native_0.mcap").write_bytes(b"m" * size)
    return folder / name


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "recordings"


async def test_recordings_are_listed_with_their_files_size_and_time(folder: Path) -> None:
    before = made(folder).listed()
    assert before["recordings"] == []
    # The folder is made by the first one.
    assert before["free_bytes"] > 0
    run = recording(folder, "run-001")
    (run / "metadata.yaml").write_text("x")
    (run / "private.txt").write_text("secret")
    (folder / "empty").mkdir()
    (folder / "file").write_text("x")
    (folder / "link").symlink_to("/etc")
    listed = made(folder).listed()
    (only,) = listed["recordings"]
    assert only["files"] == [
        {"name": "metadata.yaml", "bytes": 1},
        {"name": "native_0.mcap", "bytes": 1000},
    ]
    assert (only["name"], only["bytes"], listed["bytes"]) == ("run-001", 1001, 1001)
    assert only["at_s"] == pytest.approx(run.joinpath("metadata.yaml").stat().st_mtime)


NAMES = [
    ("..", "native_0.mcap"),
    (".", "native_0.mcap"),
    ("", "native_0.mcap"),
    ("/etc", "passwd"),
    ("run-001", "../run-001/native_0.mcap"),
    ("run-001", "../../secret"),
    ("run-001", "private.txt"),
    ("run-001", "native_0.mcap\0"),
    ("run-001", "native_0.mcap/"),
    ("run-001\n", "native_0.mcap"),
    ("run-002", "native_0.mcap"),
    ("linked", "native_0.mcap"),
    ("run-001", "native_1.mcap"),
]


@pytest.mark.parametrize(("name", "file"), NAMES)
async def test_no_name_leads_out_of_the_folder(folder: Path, name: str, file: str) -> None:
    run = recording(folder, "run-001")
    (run / "private.txt").write_text("secret")
    (folder.parent / "secret").write_text("secret")
    (folder.parent / "native_0.mcap").write_text("secret")
    (run / "native_1.mcap").symlink_to(folder.parent / "secret")
    (folder / "linked").symlink_to(folder.parent)
    recordings = made(folder)
    assert recordings.file("run-001", "native_0.mcap") == run / "native_0.mcap"
    assert recordings.file(name, file) is None


@pytest.mark.parametrize("name", ["..", ".", "", "/", "run-002", "linked", "other", 1, None, ["a"]])
async def test_only_a_recording_is_deleted(folder: Path, name: Any) -> None:
    run = recording(folder, "run-001")
    (folder.parent / "native_0.mcap").write_text("keep")
    (folder / "linked").symlink_to(folder.parent)
    (folder / "other").mkdir()
    recordings = made(folder)
    assert "exist" in await recordings.delete(name)
    assert (folder.parent / "native_0.mcap").exists()
    assert (folder / "other").exists()
    assert await recordings.delete("run-001") == ""
    assert not run.exists()


async def test_deleting_leaves_what_is_no_part_of_a_recording(folder: Path) -> None:
    run = recording(folder, "run-001")
    (run / "notes.txt").write_text("mine")
    assert await made(folder).delete("run-001") == ""
    assert [each.name for each in run.iterdir()] == ["notes.txt"]


@pytest.mark.parametrize(
    ("limit", "value", "words"),
    [("ALL_BYTES", 0, "Delete some first"), ("MOST", 1, "Delete some first")],
)
async def test_none_begins_where_enough_is_there(
    folder: Path, monkeypatch: pytest.MonkeyPatch, limit: str, value: int, words: str
) -> None:
    recording(folder, "run-001")
    monkeypatch.setattr(page_recordings, limit, value)
    assert words in await made(folder).begin()


async def test_none_begins_where_the_disk_is_nearly_full_or_not_writable(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = shutil.disk_usage(folder.parent).free
    monkeypatch.setattr(page_recordings, "FREE_BYTES", free)
    assert "GB of the disk are free" in await made(folder).begin()
    folder.rmdir()
    folder.write_text("a file")
    assert "cannot be written" in await made(folder).begin()


@pytest.mark.nightly
@pytest.mark.realtime
async def test_a_recorder_that_finds_no_robot_says_so(folder: Path) -> None:
    recordings = made(folder)
    assert await recordings.begin() == ""
    await eventually(lambda: not recordings.running)
    assert json.loads(recordings.shown())["ended"] != ""


@on_virtual_time
async def test_a_recording_ends_a_minute_after_the_last_page_that_may_record() -> None:
    clock = LoopClock()
    recordings = PageRecordings(clock, [], Path("none"), lambda: None)
    recordings.driver_came(1)
    recordings.driver_came(2)
    recordings._task = asyncio.create_task(asyncio.sleep(1e6))
    recordings.page_left(1)
    await asyncio.sleep(2 * ALONE_S)
    assert not recordings._stop.is_set()
    recordings.page_left(2)
    await asyncio.sleep(ALONE_S - 1)
    recordings.driver_came(3)
    await asyncio.sleep(2 * ALONE_S)
    assert not recordings._stop.is_set()
    recordings.page_left(3)
    await asyncio.sleep(ALONE_S + 1)
    assert recordings._stop.is_set()
    recordings._task.cancel()


async def use(page: Page, do: str, **args: Any) -> dict[str, Any]:
    number = len(page.of("answer")) + 1
    await page.send(type="tool", id=number, do=do, args=args)
    return await page.one("answer", id=number)


@pytest.mark.realtime
@pytest.mark.xdist_group("web_tools")
async def test_a_recording_is_made_downloaded_and_deleted_and_a_viewer_only_watches(
    site: Callable[..., Awaitable[Site]], real_robot: Callable[..., RealRobot], folder: Path
) -> None:
    robot = real_robot()
    await asyncio.to_thread(robot.daemon.says, "Connected to")
    served = await site(endpoint=robot.endpoint, phones=True)
    recordings = served.hub.tools.recordings
    driver, viewer = await served.page(), await served.page("viewer")
    for do in ("record", "end_recording", "delete_recording", "calibrate", "undo_calibration"):
        assert not (await use(viewer, do, name="run-001", verb="tape", choices={}))["ok"]
    assert (await use(driver, "record"))["ok"]
    assert not (await use(driver, "record"))["ok"]
    await viewer.one("recording", name="run-001")
    async with asyncio.timeout(300.0):
        while not list(folder.glob("run-001/native_0.mcap")):
            # On a busy machine a recorder may report that it did not reach the daemon in time.
            await use(driver, "record")
            await asyncio.sleep(0.1)
    assert "End it first" in (await use(driver, "delete_recording", name="run-001"))["text"]
    assert (await use(driver, "end_recording"))["ok"]
    await eventually(lambda: not recordings.running)
    shown = await viewer.one("recording", name=None, ended=json.loads(recordings.shown())["ended"])
    assert shown["ended"].startswith("run-001 has ")
    assert shown["ended"].endswith(" lost.")

    assert (await served.request("GET", "/recordings"))[0] == 401
    status, _, body = await served.request("GET", "/recordings", **served.cookie("viewer"))
    assert status == 200
    assert [each["name"] for each in json.loads(body)["recordings"]] == ["run-001"]
    path = "/recordings/run-001/native_0.mcap"
    assert (await served.request("GET", path))[0] == 401
    status, headers, body = await served.request("GET", path, **served.cookie())
    assert status == 200
    assert headers["content-disposition"] == 'attachment; filename="run-001-native_0.mcap"'
    summary = make_reader(BytesIO(body)).get_summary()
    assert summary is not None
    assert "yahboomd/pose" in {each.topic for each in summary.channels.values()}
    assert (await use(driver, "delete_recording", name="run-001"))["ok"]
    assert not (folder / "run-001").exists()
