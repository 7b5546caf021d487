"""The guard's socket: who may ask, what is asked, and who waits, in one process with it."""

from __future__ import annotations

import json
import os
import shutil
import socket
import stat
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from yahboomd.tools.port.local_stops import (
    MAX_SILENT,
    MAX_WAITING,
    LocalStops,
)
from yahboomd.tools.stop.local_socket import Peer, peer_of, tell_others


@pytest.fixture
def stops(tmp_path: Path) -> Iterator[LocalStops]:
    made = LocalStops()
    listen(made, tmp_path)
    yield made
    made.close()


@pytest.fixture
def clients() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def listen(stops: LocalStops, folder: Path | str) -> None:
    """Have it listen below its best name there."""
    if (made := stops.made(str(folder), "stop")) is not None:
        stops.listen(*made)


def asking(path: str, clients: ExitStack, request: bytes = b"") -> socket.socket:
    client = clients.enter_context(socket.socket(socket.AF_UNIX))
    client.connect(path)
    client.sendall(request)
    return client


def taken(stops: LocalStops) -> list[Any]:
    """All requests that have come."""
    found = []
    while stops._epoll.poll(0):
        found += stops.take()
    return found


def lines(client: socket.socket) -> list[dict[str, Any]]:
    client.settimeout(60.0)
    return [json.loads(line) for line in client.recv(65536).splitlines()]


def test_a_stop_has_its_answer_and_then_what_was_seen_and_names_who_asks(
    stops: LocalStops, clients: ExitStack
) -> None:
    client = asking(stops.path, clients, b"stop by yahboomd stop\n")
    (request,) = taken(stops)
    user = "root" if os.getuid() == 0 else f"user {os.getuid()}"
    assert request.by == f"`yahboomd stop` ({user}, pid {os.getpid()})"
    stops.finish(request.number, b'{"stood": true}')
    stops.answer(request.number - 1, b'{"engaged": false}')
    stops.answer(request.number, b'{"engaged": true}')
    stops.answer(request.number, b'{"engaged": "again"}')
    assert lines(client) == [{"engaged": True}]
    stops.finish(request.number, b'{"stood": true}')
    assert lines(client) == [{"stood": True}]
    assert client.recv(1) == b""


@pytest.mark.parametrize("request_", [b"s", b"stop", b"\n", b"\xff\x00", b"x" * 5000, b"statu"])
def test_whatever_else_comes_asks_for_the_stop(
    stops: LocalStops, clients: ExitStack, request_: bytes
) -> None:
    asking(stops.path, clients, request_)
    (request,) = taken(stops)
    assert request.by.startswith("the local socket (")


def test_status_says_which_robot_it_is_and_stops_nothing(
    stops: LocalStops, clients: ExitStack
) -> None:
    stops.facts = b'{"daemon": "yahboomd"}'
    for request in (b"status\n", b"status\r\n", b"status"):
        client = asking(stops.path, clients, request)
        assert taken(stops) == []
        assert lines(client) == [{"daemon": "yahboomd"}]


def test_connections_that_send_nothing_lock_no_client_out(
    stops: LocalStops, clients: ExitStack
) -> None:
    for _ in range(5):
        for _ in range(MAX_SILENT):
            asking(stops.path, clients)
        assert taken(stops) == []
    assert stops.counters["dropped"] == 4 * MAX_SILENT
    asking(stops.path, clients, b"stop\n")
    assert len(taken(stops)) == 1


def test_a_flood_of_stops_is_bounded_and_each_asks(stops: LocalStops, clients: ExitStack) -> None:
    made = [asking(stops.path, clients, b"stop\n") for _ in range(2 * MAX_WAITING)]
    assert [request.number for request in taken(stops)] == [*range(1, 2 * MAX_WAITING + 1)]
    assert all(lines(client)[0]["sent"] is None for client in made[MAX_WAITING:])
    stops.answer(2 * MAX_WAITING, b'{"sent": true}')
    assert all(lines(client)[0]["sent"] for client in made[:MAX_WAITING])


def test_one_that_leaves_makes_room(stops: LocalStops) -> None:
    with ExitStack() as clients:
        asking(stops.path, clients, b"stop\n")
        assert len(taken(stops)) == 1
    assert taken(stops) == []
    assert stops._connections == {}


def test_another_user_is_refused_with_the_reason_and_counted(
    stops: LocalStops, clients: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(LocalStops, "may_use", lambda *_: False)
    client = asking(stops.path, clients)
    assert taken(stops) == []
    assert "is not in the group of" in lines(client)[0]["error"]
    assert stops.counters["refused"] == 1


def test_where_no_connection_can_be_accepted_it_is_tried_again(
    stops: LocalStops, clients: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: socket.socket) -> Any:
        raise OSError(24, "Too many open files")

    asking(stops.path, clients, b"stop\n")
    with monkeypatch.context() as patch:
        patch.setattr(socket.socket, "accept", full)
        assert stops.take() == []
    assert len(taken(stops)) == 1


@pytest.mark.parametrize("verb", [b"next", b"held"])
def test_the_next_owner_is_heard_by_every_other_guard_if_it_may_end_one(
    stops: LocalStops, tmp_path: Path, verb: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    tell_others(str(tmp_path), stops.path, verb, 48128)
    assert taken(stops) == []
    tell_others(str(tmp_path), "", verb, 48128)
    (request,) = taken(stops)
    assert (request.verb, request.device, request.by) == (verb, 48128, "")
    # Another user's guard, in a folder that both use, ends none, and stops no robot.
    monkeypatch.setattr("yahboomd.tools.port.local_stops._trusted", lambda _: False)
    tell_others(str(tmp_path), "", verb, 48128)
    assert taken(stops) == []
    assert stops.counters["refused"] == 1


def test_the_file_is_for_the_owner_and_the_group(tmp_path: Path) -> None:
    made = LocalStops()
    listen(made, tmp_path / "run")
    status = (tmp_path / "run" / "stop.sock").stat()
    assert stat.S_IMODE(status.st_mode) == 0o660
    made.close()
    assert list((tmp_path / "run").iterdir()) == []


def test_what_a_dead_guard_left_behind_is_replaced_and_a_living_ones_socket_is_not(
    tmp_path: Path, clients: ExitStack
) -> None:
    for name in ("stop.sock", "stop-1.sock"):
        with socket.socket(socket.AF_UNIX) as dead:
            dead.bind(str(tmp_path / name))
    made = [LocalStops() for _ in range(3)]
    for each in made:
        listen(each, tmp_path)
    own = f"stop-{os.getpid()}"
    assert {path.name for path in tmp_path.iterdir()} == {
        *("stop.sock", f"{own}.sock", f"{own}-2.sock")
    }
    for each in made:
        asking(each.path, clients)
        # It has the best name that it can have.
        path = each.path
        listen(each, tmp_path)
        assert each.path == path
    made[0].close()
    listen(made[1], tmp_path)
    assert made[1].path == f"{tmp_path}/stop.sock"
    for each in made[1:]:
        each.close()


def test_in_a_folder_that_was_removed_it_listens_again(tmp_path: Path, clients: ExitStack) -> None:
    made, folder = LocalStops(), tmp_path / ("x" * 120)
    listen(made, folder)
    shutil.rmtree(folder)
    folder.touch()
    with pytest.raises(OSError, match="exists"):
        listen(made, folder)
    folder.unlink()
    listen(made, folder)
    assert (folder / "stop.sock").is_socket()
    made.close()


MEMBER = """
import os, socket, sys
os.setgroups([77, 78])
os.setresgid(4321, 4321, 4321)
os.setresuid(4321, 4321, 4321)
client = socket.socket(socket.AF_UNIX)
client.connect(sys.argv[1])
client.recv(1)
"""


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can be another user")
def test_a_member_of_the_group_by_any_of_its_groups_may_use_it() -> None:
    # Other users cannot enter tmp_path.
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o755)
        made = LocalStops()
        listen(made, folder)
        os.chown(made.path, -1, 77)
        with subprocess.Popen([sys.executable, "-c", MEMBER, made.path]):
            assert made._listening is not None
            made._listening.settimeout(60.0)
            sock, _ = made._listening.accept()
            peer = peer_of(sock)
            sock.close()
        assert (peer.uid, peer.groups) == (4321, {4321, 77, 78})
        for group in (77, 79):
            made._group = group
            assert made.may_use(peer) is (group == 77)
        made.close()


@pytest.mark.parametrize(("uid", "may"), [(0, True), (os.geteuid(), True), (4321, False)])
def test_root_and_the_own_user_may_use_it(stops: LocalStops, uid: int, may: bool) -> None:
    stops._group = 77
    assert stops.may_use(Peer(1, uid, frozenset((4321,)))) is may
