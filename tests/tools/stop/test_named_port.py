"""The port that a configuration names, read without the rest."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from yahboomd.core.config import read
from yahboomd.tools.stop.named_port import NamedPort, named_port

FILE = '[serial]\nport = "/dev/ttyUSB0"\nbaudrate = 921600\n'


def at(path: Path, text: str | bytes) -> Path:
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize(
    ("environ", "overrides"),
    [
        ({}, []),
        ({"YAHBOOMD_SERIAL__PORT": "/dev/ttyACM0", "YAHBOOMD_SERIAL__DTR": "False"}, []),
        (
            {"YAHBOOMD_SERIAL__PORT": "/dev/ttyACM0"},
            ["serial.port=/dev/ttyTHS1", "zenoh.mode=peer"],
        ),
        ({}, ['serial.port="/dev/ttyTHS1"', "serial.rts=true", "serial.hangup_on_close=true"]),
        ({"YAHBOOMD_SERIAL_PORT": "/dev/other"}, ["serial.baudrate = 57600"]),
    ],
)
def test_it_is_what_the_whole_configuration_says(
    tmp_path: Path, environ: dict[str, str], overrides: list[str]
) -> None:
    path = at(tmp_path / "robot.toml", FILE)
    found = named_port(path, environ, overrides)
    environ.pop("YAHBOOMD_SERIAL_PORT", None)
    serial = read(path, environ=environ, overrides=overrides).config.serial
    assert found == NamedPort(*(getattr(serial, name) for name in NamedPort._fields))


def test_the_option_port_is_over_all_and_the_other_keys_stay(tmp_path: Path) -> None:
    found = named_port(at(tmp_path / "robot.toml", FILE), {}, ["serial.port=/dev/b"], "/dev/c")
    assert found == NamedPort("/dev/c", 921600)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[serial]\nbaudrate = 9600\n",
        "[serial]\nport = 5\n",
        '[serial]\nport = "/dev/a"\nbaudrate = true\n',
        'serial = "/dev/a"\n',
        "[serial\n",
        b'[serial]\nport = "/dev/\xff"\n',
        '[serial]\nport = "/dev/a"\n' + ".".join("a" * 300) + " = 1\n",
        '[serial]\nport = "/dev/a"\n' + "#" * 1_000_001,
    ],
)
def test_what_is_not_plain_is_left_to_the_whole_check(tmp_path: Path, text: str | bytes) -> None:
    assert named_port(at(tmp_path / "robot.toml", text), {}, []) is None


@pytest.mark.parametrize("override", ['serial."port"=/dev/b', "'serial'.port=/dev/b", "serial=5"])
def test_a_setting_that_is_not_plain_is_left_to_the_whole_check(
    tmp_path: Path, override: str
) -> None:
    """The port of the file, which it may replace, would be that of another board."""
    assert named_port(at(tmp_path / "robot.toml", FILE), {}, [override]) is None


def test_a_pipe_in_the_place_of_the_file_holds_up_no_stop(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "robot.toml")
    assert named_port(tmp_path / "robot.toml", {}, []) is None


def test_before_the_first_words_neither_pydantic_nor_zenoh_nor_asyncio_is_imported() -> None:
    """On a slow computer each takes longer than everything else until the wheels are told."""
    code = (
        "import json, sys\n"
        "import yahboomd.cli.main, yahboomd.cli.stop, yahboomd.tools.stop.named_port\n"
        "print(json.dumps(sorted(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"pydantic", "zenoh", "asyncio", "msgspec"} & set(json.loads(done.stdout))
