"""The owner of the socket, and the users who may use it."""

from __future__ import annotations

import os
import socket
import stat
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from yahboomd.core.daemon.estop.local_socket import Listening, Peer, listen, peer_of


def connects(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX) as client:
        try:
            client.connect(str(path))
        except OSError:
            return False
    return True


def left_behind(path: Path) -> None:
    """As a killed daemon leaves its file."""
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(path))


def test_the_file_is_for_the_owner_and_the_group(tmp_path: Path) -> None:
    listening = listen(tmp_path / "run", "stop")
    assert listening.path == tmp_path / "run" / "stop.sock"
    status = listening.path.stat()
    assert stat.S_IMODE(status.st_mode) == 0o660
    assert status.st_gid == listening.group
    assert connects(listening.path)
    listening.close()
    assert list((tmp_path / "run").iterdir()) == []


def test_what_a_killed_daemon_left_behind_is_replaced(tmp_path: Path) -> None:
    left_behind(tmp_path / "stop.sock")
    left_behind(tmp_path / "stop-1.sock")
    listening = listen(tmp_path, "stop")
    assert listening.path.name == "stop.sock"
    assert connects(listening.path)
    assert [path.name for path in tmp_path.iterdir()] == ["stop.sock"]
    listening.close()


def test_a_living_daemons_socket_is_not_taken(tmp_path: Path) -> None:
    first, second, third = (listen(tmp_path, "stop") for _ in range(3))
    assert first.path.name == "stop.sock"
    assert second.path.name == f"stop-{os.getpid()}.sock"
    assert third.path.name == f"stop-{os.getpid()}-2.sock"
    assert all(connects(each.path) for each in (first, second, third))
    for each in (first, second, third):
        each.close()


def test_a_file_that_is_another_daemons_by_now_is_left_alone(tmp_path: Path) -> None:
    first = listen(tmp_path, "stop")
    first.path.unlink()
    second = listen(tmp_path, "stop")
    first.close()
    assert connects(second.path)
    second.close()


def test_a_folder_with_a_long_name_will_do(tmp_path: Path) -> None:
    folder = tmp_path / ("x" * 120)
    listening = listen(folder, "stop")
    assert (folder / "stop.sock").is_socket()
    listening.close()


def test_the_kernel_names_the_peer(tmp_path: Path) -> None:
    listening = listen(tmp_path, "stop")
    with socket.socket(socket.AF_UNIX) as client:
        client.connect(str(listening.path))
        sock, _ = listening.sock.accept()
        peer = peer_of(sock)
        sock.close()
    assert peer.pid == os.getpid()
    assert peer.uid == os.geteuid()
    assert peer.groups >= {os.getegid()}
    listening.close()


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
        listening = listen(Path(folder), "stop")
        os.chown(listening.path, -1, 77)
        with subprocess.Popen([sys.executable, "-c", MEMBER, str(listening.path)]):
            listening.sock.settimeout(60.0)
            sock, _ = listening.sock.accept()
            peer = peer_of(sock)
            sock.close()
        assert peer.uid == 4321
        assert peer.groups == {4321, 77, 78}
        assert listening._replace(group=77).may_use(peer)
        assert not listening._replace(group=79).may_use(peer)
        listening.close()


@pytest.mark.parametrize(
    ("uid", "groups", "may"),
    [
        (0, (0,), True),
        (os.geteuid(), (4321,), True),
        (4321, (4321, 77), True),
        (4321, (4321,), False),
    ],
)
def test_root_the_own_user_and_the_group_may_use_it(
    uid: int, groups: tuple[int], may: bool
) -> None:
    with socket.socket(socket.AF_UNIX) as sock:
        listening = Listening(sock, Path("/nowhere"), 0, group=77)
        assert listening.may_use(Peer(1, uid, frozenset(groups))) is may
