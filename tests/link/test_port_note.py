"""The daemon's note for the process that stops the wheels after it."""

import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from yahboomd.core import atomic_write
from yahboomd.core.link.port_identity import Device
from yahboomd.core.link.port_note import PortNote, end, folder_of, read, write

DEVICE = Device(48128, "6:1034", "1-2 1a86:7523")
NOTE = PortNote("/dev/yahboom_driver", 115200, True, False, False, DEVICE)


def test_what_was_noted_is_read(tmp_path: Path) -> None:
    assert write(NOTE, str(tmp_path))

    assert read(str(tmp_path)) == [NOTE]
    assert [each.name for each in tmp_path.iterdir()] == ["port@%2Fdev%2Fyahboom_driver"]


def test_each_daemon_has_a_note_of_its_own_and_one_for_its_newest_port_alone(
    tmp_path: Path,
) -> None:
    one = NOTE._replace(pid=1, namespace="a/b", listen=("tcp/x:1",))
    other = NOTE._replace(pid=2, path="/dev/ttyUSB1")
    for note in (one._replace(path="/dev/ttyUSB0"), other, one):
        assert write(note, str(tmp_path))

    assert sorted(read(str(tmp_path))) == sorted([one, other])
    assert {each.name for each in tmp_path.iterdir()} == {
        "port.a%2Fb@%2Fdev%2Fyahboom_driver",
        "port@%2Fdev%2FttyUSB1",
    }


def test_notes_of_daemons_that_are_gone_stay_only_where_the_wheels_may_turn(tmp_path: Path) -> None:
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    ended = NOTE._replace(pid=gone.pid, path="/dev/pts/1", ended=True)
    killed = NOTE._replace(pid=gone.pid, path="/dev/pts/2", namespace="a")
    lives = NOTE._replace(pid=os.getppid(), path="/dev/pts/3", ended=True)
    # All of them are found by name; written one by one, each would remove others.
    for number, note in enumerate((ended, killed, lives)):
        folder = tmp_path / str(number)
        folder.mkdir()
        write(note, str(folder))
        (found,) = folder.iterdir()
        found.rename(tmp_path / found.name)
        folder.rmdir()

    assert write(NOTE._replace(pid=os.getpid()), str(tmp_path))

    assert {each.path for each in read(str(tmp_path))} == {NOTE.path, "/dev/pts/2", "/dev/pts/3"}


def test_an_end_in_order_is_noted_for_this_daemon_alone(tmp_path: Path) -> None:
    one, other = NOTE._replace(pid=1), NOTE._replace(pid=2, path="/dev/ttyUSB1")
    write(one, str(tmp_path))
    write(other, str(tmp_path))

    end(str(tmp_path), 1)

    assert {note.pid: note.ended for note in read(str(tmp_path))} == {1: True, 2: False}
    # It has the port again.
    write(one, str(tmp_path))
    assert not any(note.ended for note in read(str(tmp_path)))


def test_the_latch_of_a_daemon_that_was_killed_stays_noted(tmp_path: Path) -> None:
    for killed in (True, False):
        write(NOTE._replace(pid=7, latch="/run/estop"), str(tmp_path))
        end(str(tmp_path), 7, killed=killed)
        (note,) = read(str(tmp_path))
        assert (note.ended, note.latch) == (True, "/run/estop" if killed else "")


def test_of_several_folders_the_first_is_used() -> None:
    assert folder_of({"RUNTIME_DIRECTORY": "/run/one:/run/other"}) == "/run/one"
    assert folder_of({}) == ""
    assert read("") == []


def test_on_a_full_disk_the_note_of_before_is_overwritten(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "full")

    write(NOTE._replace(pid=1, ended=True, listen=("tcp/[::1]:1", "tcp/[::1]:2")), str(tmp_path))
    monkeypatch.setattr(atomic_write, "write_atomic", full)
    assert write(NOTE, str(tmp_path))
    assert read(str(tmp_path)) == [NOTE]


def test_a_note_that_cannot_be_written_leaves_no_half_of_it(tmp_path: Path) -> None:
    write(NOTE, str(tmp_path))
    (place,) = tmp_path.iterdir()
    place.unlink()
    place.mkdir()
    assert not write(NOTE, str(tmp_path))
    assert list(tmp_path.iterdir()) == [place]


def test_a_folder_that_cannot_be_written_is_no_error(tmp_path: Path) -> None:
    assert not write(NOTE, str(tmp_path / "missing"))
    assert read(str(tmp_path / "missing")) == []


@pytest.mark.parametrize("text", ["", "{", "[]", "[" * 4096, "7", "\udcff"])
def test_what_is_no_note_is_left_out(tmp_path: Path, text: str) -> None:
    (tmp_path / "port@x").write_bytes(text.encode("utf-8", "surrogateescape"))

    assert read(str(tmp_path)) == []


@pytest.mark.parametrize(
    "wrong",
    [
        {"path": 1},
        {"baudrate": True, "dtr": 1},
        {"unknown": 1},
        {"device": None},
        {"device": [1, 2, 3]},
        {"device": 7},
    ],
)
def test_a_note_with_a_wrong_field_is_left_out(tmp_path: Path, wrong: dict[str, object]) -> None:
    place = tmp_path / "port@x"
    place.write_text(json.dumps(NOTE._asdict()))
    assert read(str(tmp_path)) == [NOTE]

    place.write_text(json.dumps(NOTE._asdict() | wrong))

    assert read(str(tmp_path)) == []


def test_a_note_without_its_device_is_left_out(tmp_path: Path) -> None:
    fields = NOTE._asdict()
    del fields["device"]
    (tmp_path / "port@x").write_text(json.dumps(fields))

    assert read(str(tmp_path)) == []
