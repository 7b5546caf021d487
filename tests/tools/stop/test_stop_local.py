"""The local half of stop, with the daemon's own sockets."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import socket
import threading
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import pytest

from yahboomd.cli import stop
from yahboomd.tools.port.local_stops import LocalStops
from yahboomd.tools.stop import stop_local
from yahboomd.tools.stop.stop_local import (
    DaemonChoice,
    LocalDaemon,
    find,
    holds,
    sockets,
    there,
)

pytestmark = pytest.mark.realtime

BOT1 = LocalDaemon(
    "/run/a", 1, namespace="bot1", ports=("/dev/a", "/dev/ttyUSB0"), listen=("tcp/x:1",)
)
SILENT = LocalDaemon("/run/b", 2, silent=True)


class Daemon:
    """A guard's socket, whose daemon has standing wheels from the stop on."""

    def __init__(self, folder: Path, namespace: str, speed: float | None) -> None:
        self.stops = 0
        self._local = LocalStops()
        self._local.facts = json.dumps({"daemon": "yahboomd", "namespace": namespace}).encode()
        made = self._local.made(str(folder), "stop")
        assert made is not None
        self._local.listen(*made)
        stood = None if speed is None else speed == 0.0
        self._seen = json.dumps({"stood": stood, "fastest_m_s": speed}).encode()
        asyncio.get_running_loop().add_reader(self._local, self._serve)

    def _serve(self) -> None:
        for request in self._local.take():
            self.stops += 1
            line = {"engaged": True, "sent": True, "message": f"Engaged by {request.by}."}
            self._local.answer(request.number, json.dumps(line).encode())
            self._local.finish(request.number, self._seen)

    def close(self) -> None:
        asyncio.get_running_loop().remove_reader(self._local)
        self._local.close()


@pytest.fixture
def environ(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """An environ with a runtime directory of its own, and no other daemon on the machine."""
    own = sockets
    monkeypatch.setattr(stop_local, "sockets", lambda environ: own(environ, root=f"{tmp_path}/"))
    # Daemon and stop are one process here, which a busy machine holds up.
    for name in ("STATUS_WITHIN_S", "ENGAGED_WITHIN_S", "STOOD_WITHIN_S"):
        monkeypatch.setattr(stop_local, name, 60.0)
    return {"RUNTIME_DIRECTORY": str(tmp_path / "own")}


@pytest.fixture
async def daemon(tmp_path: Path) -> AsyncIterator[Callable[..., object]]:
    made: list[Daemon] = []

    async def make(namespace: str = "", *, speed: float | None = 0.0) -> Daemon:
        made.append(Daemon(tmp_path / "own", namespace, speed))
        return made[-1]

    yield make
    for each in made:
        each.close()
    await asyncio.sleep(0)


async def stopped(wanted: DaemonChoice, environ: dict[str, str]) -> tuple[Any, list[tuple]]:
    stops = stop_local.LocalStops()

    def work() -> list[tuple]:
        stops.engage(wanted, find(environ))
        return [(each.robot.namespace, each.stood, each.words) for each in stops.outcomes()]

    return stops, await asyncio.to_thread(work)


async def test_every_daemon_is_stopped_where_none_is_named(daemon, environ) -> None:
    daemons = [await daemon(), await daemon("bot1"), await daemon("bot2")]
    stops, outcomes = await stopped(DaemonChoice(), environ)
    assert [each.stops for each in daemons] == [1, 1, 1]
    assert {(name, stood) for name, stood, _ in outcomes} == {
        ("", True),
        ("bot1", True),
        ("bot2", True),
    }
    assert all("The wheels stand." in words for _, _, words in outcomes)
    assert stops.silent == []


async def test_a_variable_that_names_no_robot_leaves_no_daemon_out(
    daemon, environ, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = await daemon("bot1")
    monkeypatch.setenv("RUNTIME_DIRECTORY", environ["RUNTIME_DIRECTORY"])
    monkeypatch.setenv("YAHBOOMD_LOG__LEVEL", "error")
    monkeypatch.setenv("YAHBOOMD_OF_ANOTHER_PROGRAM", "1")
    args = argparse.Namespace(port=None, namespace=None, config=None, overrides=[])
    stops = stop_local.LocalStops()
    await asyncio.to_thread(stop._stop_locally, args, stops)
    await asyncio.to_thread(stops.outcomes)
    assert made.stops == 1


async def test_one_that_is_not_named_is_left_alone(daemon, environ) -> None:
    one, other = await daemon("bot1"), await daemon("bot2")
    stops, outcomes = await stopped(DaemonChoice(namespace="bot1"), environ)
    assert (one.stops, other.stops) == (1, 0)
    assert [name for name, _, _ in outcomes] == ["bot1"]
    assert [each.namespace for each in stops.others] == ["bot2"]


@pytest.mark.parametrize(
    ("speed", "words"), [(0.4, "still turn, at 0.40 m/s"), (None, "no counts from the board")]
)
async def test_wheels_that_do_not_stand_are_not_said_to(
    daemon, environ, monkeypatch: pytest.MonkeyPatch, speed: float | None, words: str
) -> None:
    await daemon(speed=speed)
    _, ((_, stood, said),) = await stopped(DaemonChoice(), environ)
    assert not stood
    assert words in said


def frozen(folder: Path) -> socket.socket:
    """A frozen daemon as seen by others: the kernel accepts the connection, and no answer comes."""
    folder.mkdir(exist_ok=True)
    sock = socket.socket(socket.AF_UNIX)
    sock.bind(str(folder / "stop-1.sock"))
    sock.listen(8)
    return sock


async def test_one_that_does_not_answer_holds_up_no_other_and_has_the_stop_as_it_thaws(
    daemon, environ, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stop_local, "STATUS_WITHIN_S", 2.0)
    monkeypatch.setattr(stop_local, "STOOD_WITHIN_S", 1.0)
    living = await daemon()
    with frozen(tmp_path / "own") as sock:
        stops, outcomes = await stopped(DaemonChoice(), environ)
        assert living.stops == 1
        assert len(outcomes) == 1
        assert [each.pid for each in stops.silent] == [os.getpid()]
        requests = []
        for _ in range(2):
            connection, _ = sock.accept()
            requests.append(connection.recv(100))
            connection.close()
        assert requests == [b"status\n", stop_local.STOP]


async def test_one_that_does_not_answer_and_may_be_another_is_left_alone(
    environ, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stop_local, "STATUS_WITHIN_S", 0.5)
    with frozen(tmp_path / "own"):
        stops, outcomes = await stopped(DaemonChoice(namespace="bot1"), environ)
    assert (outcomes, stops.silent) == ([], [])
    assert len(stops.others) == 1


async def test_a_file_that_a_killed_daemon_left_is_no_daemon(environ, tmp_path: Path) -> None:
    frozen(tmp_path / "own").close()
    assert find(environ) == []


async def test_a_refused_user_finds_no_daemon(
    daemon, environ, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(LocalStops, "may_use", lambda *_: False)
    refusing = await daemon()
    assert await asyncio.to_thread(find, environ) == []
    assert refusing.stops == 0


@pytest.mark.parametrize(
    ("wanted", "robot", "fits"),
    [
        (DaemonChoice(), BOT1, True),
        (DaemonChoice(), SILENT, True),
        (DaemonChoice(namespace="bot1"), BOT1, True),
        (DaemonChoice(namespace=""), BOT1, False),
        (DaemonChoice(namespace="bot1"), SILENT, False),
        (DaemonChoice(namespace=""), SILENT, False),
        (DaemonChoice(port="/dev/ttyUSB0"), BOT1, True),
        (DaemonChoice(port="/dev/../dev/ttyUSB0"), BOT1, True),
        (DaemonChoice(port="/dev/ttyUSB1"), BOT1, False),
        (DaemonChoice(port="/dev/ttyUSB1"), SILENT, False),
        (DaemonChoice(namespace="bot1", listen=("tcp/x:1", "tcp/y:1")), BOT1, True),
        (DaemonChoice(namespace="bot1", listen=("tcp/y:1",)), BOT1, False),
    ],
)
def test_the_port_decides_then_the_namespace_and_where_it_listens(
    wanted: DaemonChoice, robot: LocalDaemon, fits: bool
) -> None:
    assert wanted.fits(robot) is fits


def test_a_daemon_with_a_full_queue_of_connections_is_not_overlooked(
    environ: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stop_local, "STATUS_WITHIN_S", 0.05)
    path = Path(environ["RUNTIME_DIRECTORY"]) / "stop.sock"
    path.parent.mkdir(mode=0o700)
    with contextlib.ExitStack() as stack:
        listening, *others = [stack.enter_context(socket.socket(socket.AF_UNIX)) for _ in range(4)]
        listening.bind(str(path))
        listening.listen(0)
        with contextlib.suppress(BlockingIOError):
            for each in others:
                each.setblocking(False)
                each.connect(str(path))
        assert [robot.silent for robot in find(environ)] == [True]


def test_a_process_is_known_by_the_port_that_it_has_open() -> None:
    far, near = os.openpty()
    try:
        assert holds(os.getpid(), os.ttyname(near))
        assert not holds(os.getpid(), "/dev/tty0")
        assert not holds(os.getpid(), "/nonexistent")
        assert DaemonChoice(port=os.ttyname(near)).fits(SILENT._replace(guard=os.getpid()))
    finally:
        os.close(far)
        os.close(near)


def test_sockets_of_services_and_of_the_own_user_are_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 5)
    places = [
        *("run/yahboomd/stop.sock", "run/yahboomd-front/stop.sock", "run/yahboomd/stop-7.sock"),
        *("run/user/5/yahboomd/stop.sock", "run/user/6/yahboomd/stop.sock", "x/yahboomd/stop.sock"),
    ]
    for place in places:
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / place).touch()
    environ = {"XDG_RUNTIME_DIR": str(tmp_path / "x")}
    found = sockets(environ, root=f"{tmp_path}/")
    assert {each.removeprefix(f"{tmp_path}/") for each in found} == {*places} - {places[4]}
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    assert f"{tmp_path}/{places[4]}" in sockets(environ, root=f"{tmp_path}/")


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can make another user's folder")
def test_a_socket_in_a_folder_that_a_stranger_made_is_not_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "tmp").mkdir()
    (tmp_path / "tmp").chmod(0o1777)
    folder = tmp_path / "tmp" / "yahboomd-5"
    folder.mkdir()
    (folder / "stop.sock").touch()
    monkeypatch.setattr(os, "geteuid", lambda: 5)
    for owner, asked in ((4321, False), (5, True), (0, True)):
        os.chown(folder, owner, owner)
        assert bool(sockets({}, root=f"{tmp_path}/")) is asked


def test_those_that_are_there_instead_are_named_with_the_command_that_reaches_them() -> None:
    alone = LocalDaemon("/run/c", 3, ports=("/tmp/board",))
    assert there([BOT1, alone], "stop") == (
        "bot1 (pid 1, /dev/a) runs here: `yahboomd stop --namespace bot1`.\n"
        "yahboomd (pid 3, /tmp/board) runs here: `yahboomd stop --port /tmp/board`."
    )
    assert (
        there([LocalDaemon("/run/d", 4)], "stop") == "yahboomd (pid 4) runs here: `yahboomd stop`."
    )
    assert "`yahboomd probe --namespace bot1 --connect tcp/x:1`" in there([BOT1], "probe")
    assert there([], "stop") == ""


def test_words_of_a_daemon_of_another_user_command_no_terminal() -> None:
    words = "\x1b[2J\x1b]0;mine\x07"
    lines = [{"message": words}, {"stood": None, "why": words}]
    assert stop_local._outcome(BOT1, lines).words.isprintable()


def test_a_board_that_is_gone_is_named_once_with_one_remedy() -> None:
    lines = [{"message": "Emergency stop engaged."}, {"stood": None, "why": "no port, and so on"}]
    robot = LocalDaemon("/run/c", 3, ports=("/nonexistent/board",))
    assert stop_local._outcome(robot, lines).words == (
        "Emergency stop engaged, but /nonexistent/board is gone, so no stop reached the board. "
        "The wheels may still turn: switch the motor supply off."
    )


def test_a_stop_that_could_not_be_sent_has_its_reason_and_one_remedy() -> None:
    message = (
        "Emergency stop engaged. It could not be sent, because no board is connected: it is out."
    )
    lines = [{"message": message, "sent": False}, {"stood": None, "why": "no port, and so on"}]
    robot = LocalDaemon("/run/c", 3, ports=("/nonexistent/board",))
    advice = " The wheels may still turn: switch the motor supply off."
    assert stop_local._outcome(robot, lines).words == message + advice


def test_no_socket_waits_for_another(monkeypatch: pytest.MonkeyPatch) -> None:
    together = threading.Barrier(3, timeout=60.0)

    class Stuck(stop_local.Talk):
        def __init__(self, path: str, request: bytes) -> None:
            self.path = f"{path} {request.decode()}"
            together.wait()

    monkeypatch.setattr(stop_local, "Talk", Stuck)
    talks = stop_local.ask_each([("a", b"1"), ("b", b"2"), ("c", b"3")])
    assert [talk.path for talk in talks] == ["a 1", "b 2", "c 3"]


def test_without_room_for_a_thread_each_is_asked_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def start(_: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", start)
    talks = stop_local.ask_each([("/none", b"")] * 2)
    assert [talk.connected for talk in talks] == [False, False]
    for talk in talks:
        talk.close()
