"""A name that leads elsewhere, and a device that comes back."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from yahboomd.core.link.port_identity import Device, find, identify, same

BOARD = Device(os.makedev(188, 0), "6:1034", "1-2 1a86:7523")


@pytest.fixture
def pty() -> Iterator[int]:
    master, slave = os.openpty()
    yield slave
    os.close(slave)
    os.close(master)


def on_usb(sysfs: Path, number: int, socket: str, name: str, serial: str = "") -> None:
    """A port on USB, as the kernel shows it."""
    device = sysfs / "devices" / "usb1" / socket
    port = device / f"{socket}:1.0" / name / "tty" / name
    port.mkdir(parents=True)
    (device / "idVendor").write_text("1a86\n")
    (device / "idProduct").write_text("7523\n")
    if serial:
        (device / "serial").write_text(f"{serial}\n")
    links = sysfs / "dev" / "char"
    links.mkdir(parents=True, exist_ok=True)
    (links / f"{os.major(number)}:{os.minor(number)}").symlink_to(port)
    (sysfs / "class" / "tty").mkdir(parents=True, exist_ok=True)
    (sysfs / "class" / "tty" / name).symlink_to(port)


def test_a_port_on_usb_is_known_by_its_socket_and_what_is_in_it(tmp_path: Path, pty: int) -> None:
    status = os.fstat(pty)
    on_usb(tmp_path, status.st_rdev, "1-2.4", "ttyUSB0", serial="A 5")
    assert identify(status, sysfs=str(tmp_path)).usb == "1-2.4 1a86:7523 A 5"
    assert identify(status, sysfs=str(tmp_path / "none")).usb == ""


@pytest.mark.parametrize(
    ("found", "is_it"),
    [
        (BOARD, True),
        # It dropped off the bus and came back, under the same name or another.
        (BOARD._replace(node="6:2222"), True),
        (BOARD._replace(node="6:2222", number=os.makedev(188, 1)), True),
        # Another device took its number.
        (BOARD._replace(node="6:2222", usb="1-3 1a86:7523"), False),
        (BOARD._replace(node="6:2222", usb="1-2 0403:6001"), False),
        (BOARD._replace(node="6:2222", usb=""), False),
    ],
)
def test_a_device_is_the_same_in_its_socket_alone(found: Device, is_it: bool) -> None:
    assert same(BOARD, found) is is_it
    assert same(found, BOARD) is is_it


def test_a_port_that_is_soldered_on_is_known_by_its_number() -> None:
    uart = Device(os.makedev(4, 64), "6:20", "")
    assert same(uart, uart._replace(node="6:21"))
    assert not same(uart, uart._replace(number=os.makedev(4, 65)))


def test_the_number_of_a_pseudo_terminal_that_is_gone_is_not_the_terminal(pty: int) -> None:
    device = identify(os.fstat(pty))
    assert same(device, identify(os.fstat(pty)))
    assert not same(device, device._replace(node="24:8:1"))


def test_a_pseudo_terminal_is_found_by_its_number(pty: int) -> None:
    device = identify(os.fstat(pty))
    assert find(device) == os.ttyname(pty)
    assert find(device._replace(node="24:8:1")) is None


def test_a_board_that_came_back_under_another_number_is_found(tmp_path: Path, pty: int) -> None:
    sysfs, dev, status = tmp_path / "sys", tmp_path / "dev", os.fstat(pty)
    dev.mkdir()
    on_usb(sysfs, status.st_rdev, "1-2", "ttyUSB7")
    (dev / "ttyUSB7").symlink_to(os.ttyname(pty))
    assert find(BOARD, sysfs=str(sysfs), dev=str(dev)) == str(dev / "ttyUSB7")
    elsewhere = BOARD._replace(usb="1-9 1a86:7523")
    assert find(elsewhere, sysfs=str(sysfs), dev=str(dev)) is None


def test_where_the_kernel_shows_nothing_nothing_is_found(tmp_path: Path) -> None:
    assert find(BOARD, sysfs=str(tmp_path), dev=str(tmp_path)) is None
