"""The search for the board's port, and the ports of the computer itself."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
import tty as terminal
from collections.abc import Iterator
from pathlib import Path

import pytest

from yahboomd.cli.main import main
from yahboomd.core.config import Config
from yahboomd.core.errors import PortMissing
from yahboomd.core.link import discovery
from yahboomd.core.link.discovery import Candidate, choose
from yahboomd.core.protocol.registry import usb_ids
from yahboomd.tools.stop.port_search import find_port, on_board, port_options

NOWHERE = "/nonexistent/yahboom_driver"


@pytest.fixture
def voice() -> Iterator[tuple[int, str]]:
    """A device that says nothing: its far end, which does not block, and its port."""
    far, near = pty.openpty()
    terminal.setraw(near)
    os.set_blocking(far, False)
    yield far, os.ttyname(near)
    os.close(far)
    os.close(near)


def both(voice_port: str, board_port: str) -> tuple[Candidate, ...]:
    return tuple(
        Candidate(path=path, description="", usb=usb, is_ch340=True, by_path=None)
        for path, usb in zip((board_port, voice_port), usb_ids(), strict=True)
    )


@pytest.mark.cases(1)
@pytest.mark.realtime
@pytest.mark.parametrize("dialect", ["rosmaster", "streamed"])
def test_of_two_ports_the_boards_is_found_and_the_other_hears_nothing(
    simulated_board, voice, monkeypatch: pytest.MonkeyPatch, capsys, dialect: str
) -> None:
    board = simulated_board("--dialect", dialect, "--start-up", "0")
    monkeypatch.setattr(discovery, "candidates", lambda: both(voice[1], board.port))
    assert find_port(Config()) == board.port
    with pytest.raises(BlockingIOError):
        os.read(voice[0], 100)
    assert f"{voice[1]} (1a86:7522) was not asked" in capsys.readouterr().err


@pytest.mark.nightly
@pytest.mark.realtime
def test_of_two_ports_a_stop_takes_the_one_whose_wheels_turn(
    simulated_board, voice, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    board = simulated_board()
    board.drive()
    board.kill_owner()
    monkeypatch.setattr(discovery, "candidates", lambda: both(voice[1], board.port))
    assert main(["stop", "--direct", "--set", "serial.port="]) == 0
    assert board.stands
    assert "the wheels stand" in capsys.readouterr().out
    with pytest.raises(BlockingIOError):
        os.read(voice[0], 100)


def test_the_search_of_an_only_port_imports_nothing_that_delays_a_stop() -> None:
    program = (
        "import sys\n"
        "from yahboomd.core.config import Config\n"
        "from yahboomd.core.link import discovery\n"
        "from yahboomd.tools.stop.port_search import find_port\n"
        "board = discovery.Candidate(path='/dev/B', description='', is_ch340=True, by_path=None)\n"
        "discovery.candidates = lambda: (board,)\n"
        "print(find_port(Config()), {'asyncio', 'serial_asyncio'} & set(sys.modules))\n"
    )
    ran = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert ran.stdout.endswith(" set()\n")


def test_a_named_port_is_taken_without_a_look_at_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(discovery, "candidates", lambda: pytest.fail("it looked"))
    assert find_port(Config.model_validate({"serial": {"port": "/dev/ttyX"}})) == "/dev/ttyX"


def test_a_port_is_opened_as_the_configuration_has_it() -> None:
    config = Config.model_validate({"serial": {"dtr": False, "rts": True, "hangup_on_close": True}})
    options = port_options("/dev/ttyX", config)
    assert (options.path, options.dtr, options.rts) == ("/dev/ttyX", False, True)
    assert (options.hangup_on_close, options.baudrate) == (True, 115200)


def tty(sysfs: Path, name: str, *, kind: str | None = "4", place: str = "serial0") -> None:
    """A terminal as the kernel shows it."""
    device, folder = sysfs / "devices" / place / name, sysfs / "class" / name
    device.mkdir(parents=True)
    folder.mkdir(parents=True)
    (folder / "device").symlink_to(device)
    if kind is not None:
        (folder / "type").write_text(f"{kind}\n")


def test_ports_of_the_computer_itself_are_listed_where_there_is_hardware(tmp_path: Path) -> None:
    tty(tmp_path, "ttyTHS1", kind="20")
    tty(tmp_path, "ttyAMA0", kind="32")
    tty(tmp_path, "ttyS0")
    tty(tmp_path, "ttyS9", kind="0")
    tty(tmp_path, "rfcomm0", kind=None)
    tty(tmp_path, "ttyUSB0", kind=None, place="usb1/1-2")
    tty(tmp_path, "ttyprintk", kind=None)
    (tmp_path / "class" / "console").mkdir()
    found = on_board(tmp_path / "class")
    assert [each.path for each in found] == [
        "/dev/rfcomm0",
        "/dev/ttyAMA0",
        "/dev/ttyS0",
        "/dev/ttyTHS1",
    ]
    assert found[-1].description == "on the computer itself"
    assert not any(each.is_ch340 for each in found)


def test_ports_of_the_computer_itself_are_never_chosen(tmp_path: Path) -> None:
    tty(tmp_path, "ttyTHS1")
    with pytest.raises(PortMissing):
        choose("", on_board(tmp_path / "class"), udev_name=NOWHERE)
