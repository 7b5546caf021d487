"""The black box of a daemon: when it is saved, and that nothing waits for it. On virtual time."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import logging
import os
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from yahboomd.blackbox.box_file import Box, read_box
from yahboomd.blackbox.box_keeper import AGAIN_S, REASONS, BoxKeeper, header
from yahboomd.blackbox.records import DecisionRecord, Ended, Happened
from yahboomd.blackbox.ring_file import RingFile, ring_folder, rings
from yahboomd.blackbox.saved_boxes import saved_boxes
from yahboomd.core.config import read
from yahboomd.core.link.tap import NO_TAP
from yahboomd.core.model import Event, EventKind
from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time
from yahboomd.tools.schemas.event_kinds import KINDS


class Prompt(threading.Thread):
    """A thread that is done when it was started: virtual time knows of no other thread."""

    def start(self) -> None:
        super().start()
        self.join()


@pytest.fixture(autouse=True)
def prompt_disk(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if "hangs" not in request.node.name:
        monkeypatch.setattr("yahboomd.blackbox.box_writer.threading.Thread", Prompt)


class Rig:
    """A black box in folders of its own."""

    def __init__(self, folder: Path, *overrides: str) -> None:
        self.environ = {
            "RUNTIME_DIRECTORY": str(folder / "run"),
            "STATE_DIRECTORY": str(folder / "state"),
        }
        self.rings = ring_folder(folder / "run", os.getuid())
        self.folder = folder / "state" / "blackbox"
        self.config = read(None, environ={}, overrides=overrides).config
        self.clock = LoopClock()
        self.box = BoxKeeper(self.config, self.clock, self.environ)

    def event(self, kind: EventKind) -> None:
        severity = KINDS[kind].severities[0]
        self.box.event(Event(kind=kind, severity=severity, message=f"{kind} happened."))

    @property
    def saved(self) -> list[Box]:
        return [read_box(each.path.read_bytes()) for each in saved_boxes(self.folder)]

    @property
    def reasons(self) -> list[tuple[str, ...]]:
        return [box.header.saved.reasons for box in self.saved if box.header.saved is not None]

    async def until(self, count: int) -> None:
        """Wait until this number of boxes exists."""
        async with asyncio.timeout(600.0):
            while len(saved_boxes(self.folder)) < count or self.box._writer.busy:
                await asyncio.sleep(0.1)


@contextlib.contextmanager
def rig_in(folder: Path, *overrides: str) -> Iterator[Rig]:
    rig = Rig(folder, *overrides)
    try:
        yield rig
    finally:
        rig.box.close(None)


@pytest.mark.cases(3)
@pytest.mark.parametrize("kind", REASONS)
@on_virtual_time
async def test_each_reason_has_it_saved_a_second_later(tmp_path: Path, kind: EventKind) -> None:
    with rig_in(tmp_path) as rig:
        at_ns = rig.clock.now_ns()
        rig.event(kind)
        await asyncio.sleep(0.9)
        assert rig.saved == []
        rig.event("estop_released")
        await rig.until(1)
        (box,) = rig.saved
        assert box.header.saved is not None
        assert box.header.saved.reasons == (REASONS[kind],)
        assert 1.0 <= (box.header.saved.at_ns - at_ns) * 1e-9 < 1.5
        # The consequence is in the box as well.
        meanings = [each.meaning for each in box.records]
        events = [each.event.kind for each in meanings if isinstance(each, Happened)]
        assert events == [kind, "estop_released"]
        assert rig.box.status_values()["blackbox_saved"] == 1
        assert rig.box.status_values()["blackbox_last"] == saved_boxes(rig.folder)[0].path.name


@on_virtual_time
async def test_what_is_no_reason_saves_nothing(tmp_path: Path) -> None:
    with rig_in(tmp_path) as rig:
        for kind in KINDS.keys() - REASONS.keys():
            rig.event(kind)
        await asyncio.sleep(200.0)
        assert rig.saved == []
        assert len(rings(rig.rings)) == 1
    # An orderly end leaves neither ring nor box.
    assert (rings(rig.rings), rig.saved) == ([], [])


def test_every_error_of_wheels_and_line_is_a_reason() -> None:
    errors = {kind for kind, info in KINDS.items() if "error" in info.severities}
    # The robot did not drive, or the event is all there is to explain.
    nothing = {"board_unfit", "setting_not_stored", "battery_empty", "unguarded"}
    assert errors - REASONS.keys() == nothing
    assert REASONS.keys() - errors == {"estop"}


@on_virtual_time
async def test_it_is_saved_once_a_minute_and_nothing_of_a_minute_is_missed(tmp_path: Path) -> None:
    with rig_in(tmp_path) as rig:
        began_ns = rig.clock.now_ns()
        for _ in range(180):
            rig.event("disconnected")
            rig.event("runaway_fast")
            await asyncio.sleep(1.0)
        await rig.until(3)
        moments = [box.header.saved.at_ns for box in rig.saved if box.header.saved]
        gaps = [(b - a) * 1e-9 for a, b in itertools.pairwise(moments)]
        assert all(AGAIN_S <= gap < AGAIN_S + 2.0 for gap in gaps), gaps
        assert (moments[0] - began_ns) * 1e-9 < 2.0
        assert rig.reasons[1:] == [("disconnected", "runaway")] * (len(moments) - 1)


@on_virtual_time
async def test_on_demand_it_is_saved_at_once_and_within_a_minute_it_says_when(
    tmp_path: Path,
) -> None:
    with rig_in(tmp_path) as rig:
        await asyncio.sleep(0.1)
        answer = await rig.box.save_now()
        assert answer.success
        (saved,) = saved_boxes(rig.folder)
        assert answer.data == {"path": str(saved.path)}
        await asyncio.sleep(12.0)
        answer = await rig.box.save_now()
        assert answer.success
        assert f"was saved 12 s ago ({saved.path.name})" in answer.message
        assert "again in 48 s" in answer.message
        assert len(rig.saved) == 1
        await asyncio.sleep(47.0)
        assert len(rig.saved) == 1
        await asyncio.sleep(1.1)
        await rig.until(2)
        assert rig.reasons == [("asked",), ("asked",)]


@on_virtual_time
async def test_a_disk_that_fails_is_counted_reported_once_and_holds_up_nothing(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with rig_in(tmp_path) as rig:
        rig.folder.parent.mkdir()
        rig.folder.write_text("no folder")
        for number in range(1, 4):
            rig.event("estop")
            await asyncio.sleep(AGAIN_S + 2.0)
            while rig.box._writer.busy:
                await asyncio.sleep(0.01)
            assert rig.box.status_values()["blackbox_failures"] == number
        answer = await rig.box.save_now()
        assert not answer.success
        assert str(rig.folder) in answer.message
        again = (await rig.box.save_now()).message
        assert f"could not be saved 0 s ago ({rig.folder}" in again
        # The writer of another test may end late.
        warned = [each for each in caplog.records if str(rig.folder) in each.getMessage()]
        assert [(each.name, each.levelno) for each in warned] == [
            ("yahboomd.blackbox.box_writer", logging.WARNING)
        ]
        rig.folder.unlink()
        rig.event("estop")
        await rig.until(1)


@on_virtual_time
async def test_a_disk_that_hangs_delays_neither_the_loop_nor_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The thread that writes waits for ever."""
    hung, freed = threading.Event(), threading.Event()

    def hang(*_arguments: object, **_options: object) -> None:
        hung.set()
        freed.wait(60.0)
        raise OSError("late")

    monkeypatch.setattr("yahboomd.blackbox.box_writer.save_box", hang)
    monkeypatch.setattr("yahboomd.blackbox.box_writer.END_S", 0.05)
    with rig_in(tmp_path) as rig:
        while rig.box._writer.busy:
            await asyncio.sleep(0.01)
        answer = await rig.box.save_now()
        assert not answer.success
        assert "disk" in answer.message
        assert hung.wait(60.0)
        rig.event("estop")
        await asyncio.sleep(200.0)
        assert rig.saved == []
    # It is left for the next start.
    assert len(rings(rig.rings)) == 1
    freed.set()


@on_virtual_time
async def test_switched_off_it_keeps_and_saves_nothing(tmp_path: Path) -> None:
    with rig_in(tmp_path, "blackbox.enabled=false") as rig:
        assert rig.box.recorder is None
        assert rig.box.tap is NO_TAP
        rig.event("estop")
        await asyncio.sleep(100.0)
        answer = await rig.box.save_now()
        assert not answer.success
        assert "blackbox.enabled" in answer.message
        assert rig.box.status_values()["blackbox_recording"] == 0
    assert rings(rig.rings) == []
    assert not rig.folder.exists()


@on_virtual_time
async def test_without_room_for_a_ring_the_robot_drives_as_ever(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_arguments: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with rig_in(tmp_path) as rig:
        assert rig.box.recorder is None
        assert "No space left" in caplog.text
        assert rings(rig.rings) == []


@on_virtual_time
async def test_a_reason_that_is_not_saved_yet_is_saved_at_the_end(tmp_path: Path) -> None:
    with rig_in(tmp_path) as rig:
        rig.event("estop")
    assert rig.reasons == [("estop",)]
    assert rings(rig.rings) == []


@on_virtual_time
async def test_a_crash_is_saved_at_the_end_with_its_error(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    fault = BaseExceptionGroup("tasks", [RuntimeError("the task control ended by itself")])
    rig.box.close(fault)
    (box,) = rig.saved
    assert rig.reasons == [("crash",)]
    assert box.records[-1].meaning == Ended(
        reasons=("crash",), error="RuntimeError: the task control ended by itself"
    )


@on_virtual_time
async def test_what_an_earlier_daemon_left_is_saved_one_a_minute(tmp_path: Path) -> None:
    with rig_in(tmp_path) as first:
        await asyncio.sleep(0.1)
        for _ in range(3):
            RingFile(first.rings, header(first.config, first.clock)).close(keep=True)
    with rig_in(tmp_path) as rig:
        began_ns = rig.clock.now_ns()
        await rig.until(1)
        await rig.until(3)
        assert (rig.clock.now_ns() - began_ns) * 1e-9 >= 2 * AGAIN_S
        assert rig.reasons == [("killed",)] * 3
        assert len(rings(rig.rings)) == 1


@on_virtual_time
async def test_a_stop_waits_for_no_box_of_an_earlier_daemon(tmp_path: Path) -> None:
    with rig_in(tmp_path) as first:
        await asyncio.sleep(0.1)
        for _ in range(2):
            RingFile(first.rings, header(first.config, first.clock)).close(keep=True)
    with rig_in(tmp_path) as rig:
        await rig.until(1)
        began_ns = rig.clock.now_ns()
        rig.event("estop")
        await rig.until(2)
        assert (rig.clock.now_ns() - began_ns) * 1e-9 < 2.0
        assert rig.reasons[1] == ("estop",)
        assert (
            "s ago (" + rig.box.status_values()["blackbox_last"]
            in (await rig.box.save_now()).message
        )
        await rig.until(4)
        assert rig.reasons[2:] == [("asked",), ("killed",)]


@on_virtual_time
async def test_a_crash_within_a_minute_of_another_is_left_for_the_next_start(
    tmp_path: Path,
) -> None:
    with rig_in(tmp_path) as rig:
        rig.event("estop")
        await rig.until(1)
        rig.box.close(RuntimeError("again"))
        assert len(rig.saved) == 1
        assert len(rings(rig.rings)) == 1
    with rig_in(tmp_path) as later:
        # The file's time is that of the newest record.
        os.utime(saved_boxes(rig.folder)[0].path, ns=(0, later.clock.wall_ns() - 70 * 10**9))
        await later.until(2)
        assert later.reasons[1] == ("crash",)


@on_virtual_time
async def test_who_drives_and_why_it_stands_is_in_it(tmp_path: Path) -> None:
    from yahboomd.core.messages.native import StatusSample

    def sample(why: str) -> StatusSample:
        return StatusSample(
            stamp_ns=1,
            state="standing",
            driver=None,
            since_ns=1,
            why=why,
            board={},
            link={},
            command={},
            bus={},
        )

    with rig_in(tmp_path) as rig:
        for age in range(5):
            rig.box.status(sample(f"No command for 0.5 s: the last came {age}.0 s ago."))
        answer = await rig.box.save_now()
        assert answer.success
        (box,) = rig.saved
    # Words that differ in an age are the same.
    decisions = [each.meaning for each in box.records if isinstance(each.meaning, DecisionRecord)]
    assert decisions == [
        DecisionRecord(state="standing", driver="", why="No command for 0.5 s: the last came.")
    ]


SECRETS = ("swordfish", "opensesame", "-----BEGIN PRIVATE KEY-----")


@on_virtual_time
async def test_no_credentials_are_in_a_ring_or_a_box(tmp_path: Path) -> None:
    zenoh = tmp_path / "zenoh.json5"
    zenoh.write_text(
        json.dumps(
            {
                "transport": {
                    "auth": {"usrpwd": {"user": "robot", "password": SECRETS[0]}},
                    "link": {"tls": {"listen_private_key": SECRETS[2], "x": SECRETS[1]}},
                }
            }
        )
    )
    with rig_in(tmp_path, f"zenoh.config={zenoh}", 'zenoh.listen=["tls/0.0.0.0:7447"]') as rig:
        (ring,) = rings(rig.rings)
        assert (await rig.box.save_now()).success
        (saved,) = saved_boxes(rig.folder)
        header = read_box(saved.path.read_bytes()).header
        assert header.config["zenoh"]["config"] == str(zenoh)
        found = ring.read_bytes() + repr(read_box(saved.path.read_bytes())).encode()
    assert b"tls/0.0.0.0:7447" in found
    assert [each for each in SECRETS if each.encode() in found] == []


@on_virtual_time
async def test_what_was_left_damaged_is_set_aside_and_the_next_boxes_are_saved(
    tmp_path: Path,
) -> None:
    """A pipe and a huge file are not waited for; a damaged header ends no thread."""
    with rig_in(tmp_path) as first:
        await asyncio.sleep(0.1)
        file = RingFile(first.rings, header(first.config, first.clock))
        file.close(keep=True)
    (ring,) = rings(first.rings)
    damaged = bytearray(ring.read_bytes())
    damaged[40] = 0xFF
    ring.write_bytes(damaged)
    os.mkfifo(first.rings / "blackbox-1.ring")
    (first.rings / "blackbox-2.ring").mkdir()
    (first.rings / "blackbox-3.ring").write_bytes(b"")
    os.truncate(first.rings / "blackbox-3.ring", 8 << 30)
    with rig_in(tmp_path) as rig:
        rig.event("estop")
        await rig.until(1)
        await asyncio.sleep(3 * AGAIN_S)
        status = rig.box.status_values()
        assert rig.reasons == [("estop",)]
        assert status["blackbox_failures"] == 4
        assert (status["blackbox_recording"], status["blackbox_saving"]) == (1, 1)
        assert len(rings(rig.rings)) == 1
        assert len(list(rig.rings.glob("*.ring-damaged"))) == 4


@on_virtual_time
async def test_without_memory_for_it_no_box_is_kept_and_the_status_tells(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("yahboomd.blackbox.box_keeper.ring_folder", lambda *_: None)
    rig = Rig(tmp_path)
    assert rig.box.recorder is None
    assert rig.box.status_values()["blackbox_recording"] == 0
    assert "tmpfs" in caplog.text
    rig.event("estop")
    rig.box.close(None)
