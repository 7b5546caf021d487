from __future__ import annotations

import fcntl
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from zenoh_fixtures import free_endpoint

from yahboomd.cli.main import main
from yahboomd.core.config import read
from yahboomd.tools.stop.stop_witness import believed, holds, made_by_root, settled

FOREIGN, OTHER = 65534, 65533

as_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root has several users")

STRANGER = """
import json, os, socket, sys
path, port, uid, held, turned, namespace = *sys.argv[1:3], *map(int, sys.argv[3:6]), sys.argv[6]
_, own = os.openpty()
if namespace:
    port = os.ttyname(own)
if turned:
    asked, port = port, path + ".d/port"
    os.mkdir(path + ".d")
    os.chown(path + ".d", uid, uid)
    os.symlink(asked, port)
if held:
    fd = os.open(port, os.O_RDWR | os.O_NOCTTY)
listening = socket.socket(socket.AF_UNIX)
listening.bind(path)
os.chmod(path, 0o666)
if os.geteuid() == 0:
    os.setgroups([])
    os.setgid(uid)
    os.setuid(uid)
listening.listen(8)
print("ready", flush=True)
while True:
    connection, _ = listening.accept()
    if connection.recv(100) == b"status\\n":
        lines = [{"daemon": "yahboomd", "namespace": namespace, "ports": [port], "listen": []}]
    else:
        lines = [{"engaged": True, "message": "Engaged."}, {"stood": True, "fastest_m_s": 0.0}]
    connection.sendall("".join(json.dumps(line) + "\\n" for line in lines).encode())
    connection.close()
    if turned and len(lines) == 2:
        os.unlink(port)
        os.symlink(os.ttyname(own), port)
"""


@pytest.fixture
def held_port() -> Iterator[str]:
    """A port with a mute board, which another process drives that does not answer either."""
    far, near = os.openpty()
    fcntl.flock(near, fcntl.LOCK_EX)
    os.fchmod(near, 0o666)
    yield os.ttyname(near)
    os.close(near)
    os.close(far)


@pytest.fixture
def folder(request: pytest.FixtureRequest) -> Iterator[Path]:
    """A runtime folder that every user can look into."""
    with tempfile.TemporaryDirectory(dir=getattr(request, "param", "/tmp")) as name:
        os.chmod(name, 0o755)
        yield Path(name)


@pytest.fixture
def stranger(folder: Path, held_port: str) -> Iterator[Callable[..., int]]:
    """Starts a process of another user that claims the port: ``stranger(uid, held=True)``.

    With ``turned`` it names a link, which leads to a port of its own after it has answered; as a
    ``robot`` it has a namespace, and names a port of its own.
    """
    started: list[subprocess.Popen[str]] = []

    def start(uid: int, *, held: bool = False, turned: bool = False, robot: str = "") -> int:
        how = (str(int(held)), str(int(turned)), robot)
        words = (str(folder / "stop.sock"), held_port, str(uid), *how)
        started.append(
            subprocess.Popen(
                [sys.executable, "-c", STRANGER, *words],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
        )
        assert started[-1].stdout is not None
        assert started[-1].stdout.readline() == "ready\n"
        return started[-1].pid

    yield start
    for each in started:
        each.kill()
        each.communicate()


def options(port: str) -> list[str]:
    return [
        "--port",
        port,
        "--set",
        f'zenoh.listen=["{free_endpoint()}"]',
        "--set",
        "zenoh.connect=[]",
    ]


@as_root
@pytest.mark.realtime
def test_another_users_word_that_the_wheels_stand_never_makes_the_status_0(
    stranger, folder: Path, held_port: str, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    stranger(FOREIGN)
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(folder))
    assert main(["stop", *options(held_port)]) != 0
    output = capsys.readouterr()
    assert output.out == ""
    assert f"User {FOREIGN} answers on {folder}/stop.sock, as yahboomd (pid " in output.err
    assert "This proves nothing" in output.err


@pytest.mark.nightly
@as_root
@pytest.mark.realtime
def test_root_believes_the_user_whose_process_holds_the_port(
    stranger, folder: Path, held_port: str, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    stranger(FOREIGN, held=True)
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(folder))
    assert main(["stop", *options(held_port)]) == 0
    assert "The wheels stand." in capsys.readouterr().out


@pytest.mark.nightly
@as_root
@pytest.mark.realtime
@pytest.mark.parametrize(
    ("uid", "group", "folder", "status"),
    [
        (FOREIGN, FOREIGN, "/tmp", 0),
        (OTHER, FOREIGN, "/tmp", 69),
        (OTHER, FOREIGN, "/run", 0),
        (OTHER, OTHER, "/run", 0),
    ],
    ids=["the owner", "another user", "a member of the group", "a stranger who may connect"],
    indirect=["folder"],
)
def test_other_users_believe_their_own_daemon_and_that_of_a_folder_which_root_made(
    stranger, folder: Path, held_port: str, uid: int, group: int, status: int
) -> None:
    stranger(FOREIGN)
    os.chown(folder, FOREIGN, FOREIGN)
    done = subprocess.run(
        [
            *("setpriv", f"--reuid={uid}", "--regid=65533", f"--groups={group}"),
            # This Python may be root's alone.
            *("--inh-caps=+dac_read_search", "--ambient-caps=+dac_read_search"),
            *(sys.executable, "-m", "yahboomd", "stop", *options(held_port)),
        ],
        env={**os.environ, "RUNTIME_DIRECTORY": str(folder)},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == status, done.stderr
    assert ("The wheels stand." in done.stdout) is (status == 0)


@pytest.mark.nightly
@as_root
@pytest.mark.realtime
def test_a_link_that_its_user_leads_from_the_port_to_one_of_theirs_proves_nothing(
    stranger, folder: Path, held_port: str, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    stranger(FOREIGN, turned=True)
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(folder))
    assert main(["stop", *options(held_port)]) != 0
    output = capsys.readouterr()
    assert output.out == ""
    assert "This proves nothing" in output.err


@pytest.mark.nightly
@as_root
@pytest.mark.realtime
def test_another_users_robot_that_stands_hides_no_held_port(
    stranger, folder: Path, held_port: str, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    stranger(FOREIGN, robot="other_robot")
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(folder))
    file = folder / "config.toml"
    file.write_text(
        f'serial.port = "{held_port}"\nzenoh = {{listen = ["{free_endpoint()}"], connect = []}}\n'
    )
    monkeypatch.setitem(read.__kwdefaults__, "standard_path", file)
    assert main(["stop", "--namespace", "other_robot"]) == 1
    output = capsys.readouterr()
    assert "The wheels stand." in output.out
    assert held_port in output.err


def test_a_place_is_settled_if_only_root_can_lead_its_name_elsewhere(
    folder: Path, held_port: str
) -> None:
    link = folder / "link"
    link.symlink_to(held_port)
    assert settled(str(link)) == settled(held_port) == held_port
    (folder / "file").touch()
    assert settled(str(folder / "file")) == settled("/nonexistent/file") == ""


@as_root
def test_an_id_that_was_given_to_another_users_process_is_not_believed(
    folder: Path, held_port: str
) -> None:
    own = os.getpid()
    assert holds(own, held_port)
    assert not believed(own, FOREIGN, str(folder / "stop.sock"), (held_port,))


def test_every_port_that_is_named_has_to_be_held(held_port: str, monkeypatch) -> None:
    own, uid = os.getpid(), os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: uid + 1)
    if uid == 0:
        monkeypatch.setattr("yahboomd.tools.stop.stop_witness._user_of", lambda _: FOREIGN)
        uid = FOREIGN
    assert believed(own, uid, "/tmp/x/stop.sock", (held_port,))
    assert not believed(own, uid, "/tmp/x/stop.sock", (held_port, "/dev/zero"))
    assert not believed(own, uid, "/tmp/x/stop.sock", ())
    assert not believed(0, uid, "/tmp/x/stop.sock", (held_port,))


@as_root
@pytest.mark.parametrize("folder", ["/run"], indirect=True)
def test_a_folder_is_roots_work_only_if_no_other_user_may_write_above_it(folder: Path) -> None:
    own = folder / "own"
    own.mkdir()
    os.chown(own, FOREIGN, FOREIGN)
    assert made_by_root(str(own), FOREIGN)
    assert not made_by_root(str(own), OTHER)
    link = folder / "link"
    link.symlink_to(own)
    assert made_by_root(str(link), FOREIGN)
    os.chmod(folder, 0o775)
    assert not made_by_root(str(own), FOREIGN)
    os.chmod(folder, 0o755)
    os.chown(folder, FOREIGN, FOREIGN)
    assert not made_by_root(str(own), FOREIGN)
    assert not made_by_root("/nonexistent/folder", 0)
