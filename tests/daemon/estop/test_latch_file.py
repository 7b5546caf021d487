"""The e-stop's file."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from hashlib import sha256
from pathlib import Path
from urllib.parse import quote

import pytest

from yahboomd.core.config import Config
from yahboomd.core.daemon.estop.latch_file import LatchFile, engaged_in

FULL = """
import sys
from hashlib import sha256
from pathlib import Path
from yahboomd.core.daemon.estop.latch_file import LatchFile
folder = Path(sys.argv[1])
(folder / "everything").write_bytes(b"") if sys.argv[2] == "names" else None
try:
    with open(folder / "everything", "wb", buffering=0) as file:
        while True:
            file.write(bytes(4096))
except OSError:
    pass
try:
    LatchFile(folder / "estop").engage("a query")
except OSError as error:
    print("full", error.errno)
else:
    print(LatchFile(folder / "estop").load())
(folder / "everything").unlink()
LatchFile(folder / "estop").engage("a query")
print(LatchFile(folder / "estop").load())
print(sorted(path.name for path in folder.iterdir()))
"""


def on_a_small_disk(folder: Path, options: str, what: str) -> list[str]:
    """Run FULL on a file system of one page, in a mount namespace of its own."""
    command = f"mount -t tmpfs -o {options} tmpfs {folder} && exec {sys.executable} -c '{FULL}'"
    ran = subprocess.run(
        ["unshare", "-m", "sh", "-c", f"{command} {folder} {what}"],
        capture_output=True,
        text=True,
        check=False,
    )
    if ran.returncode:
        pytest.skip(f"no file system can be mounted here: {ran.stderr.strip()}")
    return ran.stdout.splitlines()


def test_an_engaged_latch_is_remembered_with_who_engaged_it(tmp_path: Path) -> None:
    path = tmp_path / "run" / "estop"
    LatchFile(path).engage("a query")
    assert LatchFile(path).load() == "a query"
    LatchFile(path).engage("another one")
    assert LatchFile(path).load() == "a query"


def test_a_released_latch_is_forgotten(tmp_path: Path) -> None:
    file = LatchFile(tmp_path / "estop")
    file.engage("a query")
    file.release()
    assert file.load() is None
    file.release()


def test_without_a_file_or_a_folder_nothing_is_engaged(tmp_path: Path) -> None:
    for path in (tmp_path / "estop", tmp_path / "none" / "estop"):
        LatchFile(path, port="").release()
        assert LatchFile(path, port="").load() is None


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[]", b"\xff\xfe", b'{"engaged": true}', b"[" * 4096]
)
def test_a_damaged_file_counts_as_engaged(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "estop"
    path.write_bytes(content)
    assert LatchFile(path).load() is not None


@pytest.mark.parametrize("kind", ["fifo", "link", "folder"])
def test_what_is_no_file_counts_as_engaged_and_does_not_hang_the_start(
    tmp_path: Path, kind: str, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "estop"
    {"fifo": os.mkfifo, "link": lambda at: at.symlink_to("gone"), "folder": Path.mkdir}[kind](path)
    assert str(LatchFile(path).load()).startswith("unknown")
    assert f"{path} " in caplog.text
    # It is on file, in its way.
    LatchFile(path).engage("a query")


def test_a_folder_that_cannot_be_written_raises(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match="file"):
        LatchFile(tmp_path / "file" / "estop").engage("a query")


def test_a_folder_that_another_user_made_counts_as_engaged_and_is_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    tmp_path.chmod(0o1777)
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "yahboomd-0").symlink_to("elsewhere")
    file = LatchFile(tmp_path / "yahboomd-0" / "estop")
    assert file.load() == "unknown (its folder cannot be used)"
    assert "estop.latch_file = " in caplog.text
    with pytest.raises(PermissionError):
        file.engage("a query")


def test_a_disk_that_is_full_has_room_for_the_name_and_that_is_enough(tmp_path: Path) -> None:
    first, second, names = on_a_small_disk(tmp_path, "size=4k", "content")
    assert first == "unknown (its file is damaged)"
    assert second == first
    assert names == "['estop']"


def test_a_disk_without_room_for_a_name_is_written_once_there_is_room(tmp_path: Path) -> None:
    first, second, names = on_a_small_disk(tmp_path, "size=8k,nr_inodes=2", "names")
    assert first == "full 28"
    assert second == "a query"
    assert names == "['estop']"


def test_nothing_but_the_latch_is_left_behind(tmp_path: Path) -> None:
    LatchFile(tmp_path / "estop").engage("a query")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["estop"]


def named(folder: Path, port: str, namespace: str = "") -> LatchFile:
    name = f"estop{'.' if namespace else ''}{namespace}{'@' if port else ''}{quote(port, safe='')}"
    return LatchFile(folder / name, port=port)


@pytest.mark.cases(3)
@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("/dev/ttyUSB0", "/dev/ttyUSB1"),
        ("/tmp/board", "/dev/ttyUSB0"),
        ("/tmp/board", ""),
        ("", "/tmp/board"),
        ("/tmp/one", "/tmp/two"),
    ],
)
def test_robots_on_different_ports_have_latches_of_their_own(
    tmp_path: Path, one: str, other: str
) -> None:
    named(tmp_path, one).engage("a query")
    assert named(tmp_path, other).load() is None
    named(tmp_path, other).engage("another")
    named(tmp_path, other).release()
    assert named(tmp_path, one).load() == "a query"


@pytest.mark.parametrize(
    ("one", "other"), [("", "/dev/ttyUSB0"), ("/dev/ttyUSB0", ""), ("/dev/../dev/x", "/dev/x")]
)
def test_what_may_be_the_same_board_by_another_name_stays_engaged_until_released(
    tmp_path: Path, one: str, other: str
) -> None:
    named(tmp_path, one).engage("a query")
    assert named(tmp_path, other).load() == "a query"
    named(tmp_path, other).release()
    assert named(tmp_path, one).load() is None


@pytest.mark.parametrize(
    ("one", "other"),
    [("", ""), ("/dev/x", ""), ("", "/dev/x"), ("/dev/x", "/dev/y"), ("/tmp/x", "/tmp/y")],
)
def test_the_latch_of_another_namespace_is_another_robots(
    tmp_path: Path, one: str, other: str
) -> None:
    named(tmp_path, one, "a").engage("a query")
    assert named(tmp_path, other).load() is None
    assert named(tmp_path, other, "b").load() is None


@pytest.mark.cases(3)
@pytest.mark.parametrize("port", ["/dev/x", "/tmp/board"])
@pytest.mark.parametrize(("before", "after"), [("a", "b"), ("", "b"), ("a", "")])
def test_a_robot_with_a_new_name_is_still_stopped_on_the_port_that_both_configurations_name(
    tmp_path: Path, before: str, after: str, port: str
) -> None:
    named(tmp_path, port, before).engage("a query")
    (tmp_path / f"port@{quote(port, safe='')}").touch()
    assert named(tmp_path, port, after).load() == "a query"
    named(tmp_path, port, after).release()
    assert named(tmp_path, port, before).load() is None
    assert [path.name[:5] for path in tmp_path.iterdir()] == ["port@"]


@pytest.mark.skipif(os.getuid() != 0, reason="only root makes a device, and could remove one")
def test_a_device_in_the_place_of_the_file_is_not_removed(tmp_path: Path) -> None:
    path = tmp_path / "estop"
    os.mknod(path, 0o666 | stat.S_IFCHR, os.makedev(1, 3))
    with pytest.raises(OSError, match=r"a device; set estop\.latch_file"):
        LatchFile(path).release()
    assert path.is_char_device()


def test_an_engaged_emergency_stop_of_any_daemon_on_the_port_is_found(tmp_path: Path) -> None:
    def engaged(name: str, port: str) -> bool:
        (tmp_path / name).touch()
        found = engaged_in(tmp_path, port)
        (tmp_path / name).unlink()
        return found == tmp_path / name

    usb = quote("/dev/ttyUSB0", safe="")
    assert engaged(f"estop@{usb}", "/dev/ttyUSB0")
    assert engaged(f"estop.bot1@{usb}", "/dev/ttyUSB0")
    assert engaged("estop", "/dev/ttyUSB0")
    assert engaged("estop.bot1", "/dev/ttyUSB0")
    assert not engaged(f"estop@{usb}", "/dev/ttyUSB1")
    assert not engaged("estop", "/tmp/board")
    assert engaged(f"estop@{quote('/tmp/board', safe='')}", "/tmp/board")
    assert not engaged(f"port@{usb}", "/dev/ttyUSB0")
    with pytest.raises(FileNotFoundError):
        engaged_in(tmp_path / "nowhere", "/dev/ttyUSB0")


@pytest.mark.parametrize(
    ("namespace", "port", "name"),
    [
        ("", "", "estop"),
        ("bot1", "", "estop.bot1"),
        ("site/bot1", "/dev/ttyUSB0", "estop.site%2Fbot1@%2Fdev%2FttyUSB0"),
        ("", "/dev/yahboom_driver", "estop@%2Fdev%2Fyahboom_driver"),
        ("", "/" + "a" * 130, f"estop@{sha256(b'%2F' + b'a' * 130).hexdigest()}"),
    ],
)
def test_no_version_changes_the_files_name_or_format(
    tmp_path: Path, namespace: str, port: str, name: str
) -> None:
    """One that did would start a stopped robot released, after an update or on the way back."""
    config = Config.model_validate({"zenoh": {"namespace": namespace}, "serial": {"port": port}})
    path = config.latch_path({"RUNTIME_DIRECTORY": str(tmp_path)}, user_id=0)
    assert path == tmp_path / name
    LatchFile(path).engage("a person")
    assert path.read_bytes() == b'{"engaged": true, "by": "a person"}'
    path.write_bytes(b'{"engaged": true, "by": "an older version"}')
    assert LatchFile(path).load() == "an older version"
