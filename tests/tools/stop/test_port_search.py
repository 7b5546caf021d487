"""The search for the board's port, and the ports of the computer itself."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
import tty as terminal
from pathlib import Path

import pytest

from yahboomd.core.config import Config
from yahboomd.core.errors import PortMissing
from yahboomd.core.link import discovery
from yahboomd.core.link.discovery import Candidate, choose
from yahboomd.core.protocol.registry import usb_ids
from yahboomd.tools.stop.port_search import find_port, on_board, port_options

NOWHERE = "/nonexistent/yahboom_driver"


@pytest.mark.realtime
@pytest.mark.parametrize("dialect", ["rosmaster", "streamed"])
def test_of_two_ports_the_boards_is_found_and_the_other_hears_nothing(
    simulated_board, monkeypatch: pytest.MonkeyPatch, capsys, dialect: str
) -> None:
    board = simulated_board("--dialect", dialect, "--start-up", "0")
    voice, far = pty.openpty()
    try:
        terminal.setraw(far)
        os.set_blocking(voice, False)
        paths = (os.ttyname(far), board.port)
        found = tuple(
            Candidate(path=path, description="", usb=usb, is_ch340=True, by_path=None)
            for path, usb in zip(paths, reversed(usb_ids()), strict=True)
        )
        monkeypatch.setattr(discovery, "candidates", lambda: found)
        assert find_port(Config()) == board.port
        with pytest.raises(BlockingIOError):
            os.read(voice, 100)
    finally:
        os.close(voice)
        os.close(far)
    assert f"{paths[0]} (1a86:7522) was not asked" in capsys.readouterr().err


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
    assert ran.stdout == "/dev/B set()\n"


def test_a_named_port_is_taken_without_a_look_at_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(discovery, "candidates", lambda: pytest.fail("it looked"))
    assert find_port(Config.of({"serial": {"port": "/dev/ttyX"}})) == "/dev/ttyX"


def test_a_port_is_opened_as_the_configuration_has_it() -> None:
    config = Config.of({"serial": {"dtr": False, "rts": True, "hangup_on_close": True}})
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
