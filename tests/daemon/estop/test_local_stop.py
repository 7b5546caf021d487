"""Stopping over the local socket, in one process with it."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import os
import resource
import shutil
import socket
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from zenoh_fixtures import PATIENCE_S, eventually

from yahboomd.core.daemon.estop import local_stop
from yahboomd.core.daemon.estop.local_socket import Listening
from yahboomd.core.daemon.estop.local_stop import MAX_SILENT, MAX_WATCHING, LocalStop
from yahboomd.core.messages.native import ServiceReply

STAMPS_NS = itertools.count(0, 15_000_000)
"""Three readings prove that wheels stand."""

pytestmark = pytest.mark.realtime


class Robot:
    """Counts its stops."""

    def __init__(self, folder: Path) -> None:
        self.engaged_by: list[str] = []
        self.path = folder / "stop.sock"
        self.local = LocalStop(
            folder,
            engage=self.engage,
            acknowledged=self.acknowledged,
            facts=lambda: {"namespace": "bot1", "why": "At rest."},
        )

    def engage(self, by: str) -> str:
        self.engaged_by.append(by)
        return "Engaged."

    async def acknowledged(self, words: str) -> ServiceReply:
        return ServiceReply(success=True, message=words)

    async def ask(self, request: bytes, *, end: bool = False) -> list[dict[str, Any]]:
        """Send a request; the lines that come until the other side closes."""
        reader, writer = await self.connect(request)
        if end:
            writer.write_eof()
        lines = (await reader.read()).splitlines()
        writer.close()
        return [json.loads(line) for line in lines]

    async def connect(self, request: bytes) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        reader, writer = await asyncio.open_unix_connection(str(self.path))
        writer.write(request)
        return reader, writer


@pytest.fixture
async def robot(tmp_path: Path) -> AsyncIterator[Robot]:
    robot = Robot(tmp_path)
    await robot.local.open()
    yield robot
    robot.local.close()
    await asyncio.sleep(0)


async def until_engaged(robot: Robot, count: int = 1) -> None:
    while len(robot.engaged_by) < count:
        await asyncio.sleep(0)


async def until_watched(robot: Robot) -> None:
    """Until it was sent, from when on the wheels are watched."""
    while not robot.local._watches:
        await asyncio.sleep(0)


async def test_a_stop_is_acknowledged_and_then_the_standing_wheels_are_reported(
    robot: Robot,
) -> None:
    reader, writer = await robot.connect(b"stop by yahboomd stop\n")
    first = json.loads(await reader.readline())
    assert first == {"engaged": True, "sent": True, "message": "Engaged."}
    for speed in (0.3, 0.01, 0.2, 0.01, -0.01, 0.02):
        robot.local.observe(next(STAMPS_NS), (speed, -speed))
    last = json.loads(await reader.readline())
    assert last == {"stood": True, "fastest_m_s": 0.02, "why": "At rest."}
    assert await reader.read() == b""
    writer.close()
    (by,) = robot.engaged_by
    user = "root" if os.getuid() == 0 else f"user {os.getuid()}"
    assert by == f"`yahboomd stop` ({user}, pid {os.getpid()})"


async def test_another_program_on_the_local_socket_is_not_called_yahboomd_stop(
    robot: Robot,
) -> None:
    asking = asyncio.create_task(robot.ask(b"stop\n"))
    await until_watched(robot)
    robot.local.observe(next(STAMPS_NS), (0.0,))
    assert robot.engaged_by[0].startswith("the local socket (")
    for _ in range(3):
        robot.local.observe(next(STAMPS_NS), (0.0,))
    await asking


@pytest.mark.parametrize("speed", [None, 0.4])
async def test_wheels_that_are_not_seen_to_stand_are_not_said_to(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, speed: float | None
) -> None:
    monkeypatch.setattr(local_stop, "STAND_WITHIN_S", 0.05)
    asking = asyncio.create_task(robot.ask(b"stop\n"))
    await until_watched(robot)
    if speed is not None:
        robot.local.observe(next(STAMPS_NS), (speed,))
    _, last = await asking
    assert last["stood"] is (None if speed is None else False)
    assert last["fastest_m_s"] == speed


async def test_status_says_which_robot_it_is_and_stops_nothing(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(local_stop, "REQUEST_WITHIN_S", PATIENCE_S)
    for request in (b"status\n", b"status\r\n"):
        assert await robot.ask(request) == [{"namespace": "bot1", "why": "At rest."}]
    # Byte by byte, too.
    reader, writer = await robot.connect(b"")
    for byte in b"status\n":
        writer.write(bytes((byte,)))
        await asyncio.sleep(0.001)
    assert json.loads(await reader.readline())["namespace"] == "bot1"
    writer.close()
    assert robot.engaged_by == []


@pytest.mark.parametrize("request_", [b"s", b"stop", b"\n", b"\xff\x00", b"x" * 5000, b"statu"])
async def test_whatever_else_comes_engages_the_stop(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, request_: bytes
) -> None:
    monkeypatch.setattr(local_stop, "STAND_WITHIN_S", 0.0)
    asking = asyncio.create_task(robot.ask(request_, end=True))
    await until_engaged(robot)
    await asyncio.gather(asking, return_exceptions=True)
    assert len(robot.engaged_by) == 1


async def test_half_a_request_is_decided_when_its_time_is_over(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(local_stop, "REQUEST_WITHIN_S", 0.2)
    _, half = await robot.connect(b"st")
    reader, silent = await robot.connect(b"")
    await until_engaged(robot)
    assert await reader.read() == b""
    assert len(robot.engaged_by) == 1
    assert robot.local.status_values()["local_dropped"] == 1
    half.close()
    silent.close()


async def test_connections_that_send_nothing_lock_no_client_out(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(local_stop, "REQUEST_WITHIN_S", PATIENCE_S)
    monkeypatch.setattr(local_stop, "STAND_WITHIN_S", PATIENCE_S)
    silent = [await robot.connect(b"") for _ in range(5 * MAX_SILENT)]
    assert (await robot.ask(b"status\n"))[0]["namespace"] == "bot1"
    asking = asyncio.create_task(robot.ask(b"stop\n"))
    await until_watched(robot)
    # Two more may have made room for those that asked.
    assert 0 <= robot.local.status_values()["local_dropped"] - 4 * MAX_SILENT <= 2
    for _ in range(3):
        robot.local.observe(next(STAMPS_NS), (0.0,))
    assert (await asking)[1]["stood"]
    for _, writer in silent:
        writer.close()


async def test_a_request_is_read_before_its_connection_makes_room_for_another(
    robot: Robot,
) -> None:
    listening = robot.local._listening
    assert listening is not None
    clients = [socket.socket(socket.AF_UNIX) for _ in range(MAX_SILENT + 1)]
    clients[0].connect(str(robot.path))
    robot.local._accept(listening)
    # It arrives once the connection is known, and before the loop looks at it again.
    clients[0].send(b"stop\n")
    for client in clients[1:]:
        client.connect(str(robot.path))
        robot.local._accept(listening)
    assert len(robot.engaged_by) == 1
    for client in clients:
        client.close()


async def test_a_flood_of_stops_is_acknowledged_and_bounded(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(local_stop, "STAND_WITHIN_S", PATIENCE_S)
    count = 3 * MAX_WATCHING
    connections = [await robot.connect(b"stop\n") for _ in range(count)]
    await until_engaged(robot, count)
    for reader, _ in connections:
        assert json.loads(await reader.readline())["engaged"]
    assert len(robot.local._tasks) == MAX_WATCHING
    for _ in range(3):
        robot.local.observe(next(STAMPS_NS), (0.0,))
    for reader, writer in connections:
        await reader.read()
        writer.close()
    assert robot.local.status_values()["local_stops"] == count


async def test_another_user_is_refused_with_the_reason_and_counted(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(Listening, "may_use", lambda *_: False)
    for _ in range(2):
        (answer,) = await robot.ask(b"")
        assert "is not in the group of" in answer["error"]
    assert robot.engaged_by == []
    assert robot.local.status_values()["local_refused"] == 2
    assert len(caplog.messages) == 1


async def test_a_daemon_without_the_socket_goes_on_and_says_so(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").touch()
    robot = Robot(tmp_path / "file")
    await robot.local.open()
    assert "reaches this daemon over the bus alone" in caplog.text
    assert robot.local.status_values()["local_socket"] == ""
    robot.local.close()


async def test_a_folder_whose_name_is_not_utf8_is_one_that_the_status_can_name(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "\udcff"
    folder.mkdir()
    robot = Robot(folder)
    await robot.local.open()
    assert robot.local.status_values()["local_socket"] == f"{tmp_path}/?/stop.sock"
    robot.local.close()


@pytest.mark.parametrize("from_the_start", [False, True])
async def test_in_a_folder_that_was_removed_it_listens_again_once_it_can(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, from_the_start: bool
) -> None:
    monkeypatch.setattr(local_stop, "LOOK_S", 0.01)
    session = tmp_path / "session"
    robot = Robot(session / "yahboomd")
    if from_the_start:
        # No session of this user, because a file stands in its folder's place.
        session.touch()
    await robot.local.open()
    if not from_the_start:
        shutil.rmtree(session)
        session.touch()
        await eventually(lambda: robot.local.status_values()["local_socket"] == "")
    session.unlink()
    await eventually(lambda: robot.local.status_values()["local_socket"] == str(robot.path))
    assert (await robot.ask(b"status\n"))[0]["namespace"] == "bot1"
    robot.local.close()


async def test_the_file_is_gone_once_it_is_closed(robot: Robot) -> None:
    assert robot.local.status_values()["local_socket"] == str(robot.path)
    robot.local.close()
    assert not robot.path.exists()


async def test_where_no_connection_can_be_accepted_it_is_tried_again(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(local_stop, "PAUSE_S", 0.01)
    # Once more with the descriptor that is kept.
    accept, left = socket.socket.accept, [5]

    def full(sock: socket.socket) -> Any:
        if left[0]:
            left[0] -= 1
            raise OSError(24, "Too many open files")
        return accept(sock)

    monkeypatch.setattr(socket.socket, "accept", full)
    assert (await robot.ask(b"status\n"))[0]["namespace"] == "bot1"
    assert robot.local.status_values()["local_dropped"] == 2


@pytest.fixture
def exhausted() -> Iterator[Callable[[], None]]:
    """Takes every descriptor that this process may still have."""
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    taken: list[int] = []

    def take() -> None:
        resource.setrlimit(resource.RLIMIT_NOFILE, (512, limits[1]))
        with contextlib.suppress(OSError):
            while True:
                taken.append(os.open(os.devnull, os.O_RDONLY))
        assert taken

    yield take
    for each in taken:
        os.close(each)
    resource.setrlimit(resource.RLIMIT_NOFILE, limits)


async def test_a_stop_is_obeyed_with_all_descriptors_taken_and_so_is_the_next(
    robot: Robot, exhausted: Callable[[], None]
) -> None:
    asking = [socket.socket(socket.AF_UNIX) for _ in range(2)]
    exhausted()
    for number, each in enumerate(asking, start=1):
        with each:
            each.setblocking(False)
            each.connect(str(robot.path))
            each.send(b"stop by yahboomd stop\n")
            await asyncio.wait_for(until_engaged(robot, number), PATIENCE_S)
            while robot.local.status_values()["local_stops"] < number:
                await asyncio.sleep(0)
            await until_watched(robot)
            for _ in range(3):
                robot.local.observe(next(STAMPS_NS), (0.0, 0.0))
            while robot.local._tasks:
                await asyncio.sleep(0)
    assert robot.local.status_values()["local_dropped"] == 0
