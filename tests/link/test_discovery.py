"""The port that is chosen, and the fault without one."""

from __future__ import annotations

from pathlib import Path

import pytest

from yahboomd.core.errors import ConfigError, PortMissing
from yahboomd.core.link.discovery import Candidate, candidates, choose, on_board, without_driver

NOWHERE = "/nonexistent/yahboom_driver"


def board(path: str) -> Candidate:
    return Candidate(path=path, description="USB Serial", is_ch340=True, by_path=None)


def other(path: str) -> Candidate:
    return Candidate(path=path, description="GPS", is_ch340=False, by_path=None)


def test_a_configured_port_is_taken_as_it_is() -> None:
    assert choose("/dev/ttyX", [board("/dev/ttyUSB0")]) == "/dev/ttyX"


def test_the_name_of_the_udev_rule_comes_before_a_search(tmp_path: Path) -> None:
    name = tmp_path / "yahboom_driver"
    name.touch()
    assert choose("", [board("/dev/ttyUSB0")], udev_name=str(name)) == str(name)


def test_the_only_ch340_is_taken() -> None:
    found = [other("/dev/ttyACM0"), board("/dev/ttyUSB1")]
    assert choose("", found, udev_name=NOWHERE) == "/dev/ttyUSB1"


def test_several_boards_are_listed_and_none_is_taken() -> None:
    found = [board("/dev/ttyUSB0"), board("/dev/ttyUSB1")]
    with pytest.raises(ConfigError, match=r"/dev/ttyUSB0, /dev/ttyUSB1.*--port"):
        choose("", found, udev_name=NOWHERE)


def test_no_board_names_the_ports_that_are_there() -> None:
    with pytest.raises(PortMissing, match=r"/dev/ttyACM0 \(GPS\).*--port"):
        choose("", [other("/dev/ttyACM0")], udev_name=NOWHERE)


def usb_device(sysfs: Path, *, driver: str | None = None, tty: bool = False) -> None:
    folder = sysfs / "1-2"
    interface = folder / "1-2:1.0"
    interface.mkdir(parents=True)
    (folder / "idVendor").write_text("1a86\n")
    (folder / "idProduct").write_text("7522\n")
    if driver:
        (sysfs / "drivers" / driver).mkdir(parents=True)
        (interface / "driver").symlink_to(sysfs / "drivers" / driver)
    if tty:
        (interface / "ttyUSB0").mkdir()


def test_a_board_without_a_tty_names_the_missing_driver(tmp_path: Path) -> None:
    usb_device(tmp_path)
    assert "ch341" in without_driver(tmp_path)


def test_a_board_taken_by_brltty_names_it(tmp_path: Path) -> None:
    usb_device(tmp_path, driver="usbfs")
    assert "brltty" in without_driver(tmp_path)


def test_a_board_with_a_tty_is_nothing_to_complain_about(tmp_path: Path) -> None:
    usb_device(tmp_path, driver="ch341", tty=True)
    assert without_driver(tmp_path) == ""


def test_looking_at_this_machine_does_not_fail() -> None:
    assert isinstance(candidates(), tuple)


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
