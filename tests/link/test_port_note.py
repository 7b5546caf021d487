"""What the daemon leaves for whoever must stop the wheels after it."""

import subprocess
import sys
from pathlib import Path

import pytest

from yahboomd.link.port_note import PortNote, read, write

NOTE = PortNote("/dev/yahboom_driver", 115200, True, False, False)


def test_what_was_noted_is_read(tmp_path: Path) -> None:
    environ = {"RUNTIME_DIRECTORY": str(tmp_path)}

    assert write(NOTE, environ)

    assert read(environ) == NOTE
    assert [each.name for each in tmp_path.iterdir()] == ["port"]


def test_a_newer_note_replaces_an_older_one(tmp_path: Path) -> None:
    environ = {"RUNTIME_DIRECTORY": str(tmp_path)}
    write(NOTE, environ)

    write(NOTE._replace(path="/dev/ttyUSB1"), environ)

    assert read(environ) == NOTE._replace(path="/dev/ttyUSB1")


def test_of_several_folders_the_first_is_used(tmp_path: Path) -> None:
    write(NOTE, {"RUNTIME_DIRECTORY": f"{tmp_path}:/run/other"})

    assert (tmp_path / "port").exists()


def test_without_a_service_manager_nothing_is_noted() -> None:
    assert not write(NOTE, {})
    assert read({}) is None


def test_a_folder_that_cannot_be_written_is_no_error(tmp_path: Path) -> None:
    environ = {"RUNTIME_DIRECTORY": str(tmp_path / "missing")}

    assert not write(NOTE, environ)
    assert read(environ) is None


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "7",
        "\udcff",
        '{"path": "/dev/ttyUSB0"}',
        '{"path": 1, "baudrate": 115200, "dtr": true, "rts": false, "hangup_on_close": false}',
        '{"path": "/dev/a", "baudrate": true, "dtr": 1, "rts": false, "hangup_on_close": false}',
        '{"path": "a", "baudrate": 1, "dtr": true, "rts": true, "hangup_on_close": false, "x": 1}',
    ],
)
def test_a_damaged_note_is_none(tmp_path: Path, text: str) -> None:
    (tmp_path / "port").write_bytes(text.encode("utf-8", "surrogateescape"))

    assert read({"RUNTIME_DIRECTORY": str(tmp_path)}) is None


def test_reading_it_loads_nothing_that_takes_long() -> None:
    code = (
        "import sys; import yahboomd.link.port_note; "
        "print(*sorted({'asyncio', 'pydantic', 'zenoh', 'msgspec', 'serial'} & set(sys.modules)))"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert ran.stdout.strip() == ""
