"""Finds the board's port: by its udev name, else as the only CH340 on USB, else by asking.

Also what a person needs to know when there is none: the device may be on USB without a tty (some
Jetson kernels lack the ch341 driver), or brltty may have taken it.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import msgspec
from serial.tools import list_ports

from yahboomd.core.errors import ConfigError, PortMissing

UDEV_NAME = "/dev/yahboom_driver"

CH340_IDS = frozenset({(0x1A86, 0x7522), (0x1A86, 0x7523)})
"""Vendor and product of the USB-serial chip; other boards carry it too."""


class Candidate(msgspec.Struct, frozen=True, kw_only=True):
    """A serial port that the system has.

    Attributes:
        path: The device.
        description: What the system calls it.
        is_ch340: Whether its USB ids are those of the board's chip.
        by_path: A name that stays with the USB socket, where there is one.
    """

    path: str
    description: str
    is_ch340: bool
    by_path: str | None


def candidates() -> tuple[Candidate, ...]:
    """The serial ports of this machine that could be a board, the likely ones first."""
    found = [
        Candidate(
            path=port.device,
            description=port.description or "",
            is_ch340=(port.vid, port.pid) in CH340_IDS,
            by_path=_by_path(port.device),
        )
        for port in list_ports.comports()
        if port.vid is not None
    ]
    return tuple(sorted(found, key=lambda each: (not each.is_ch340, each.path)))


def on_board(sysfs: Path = Path("/sys/class/tty")) -> tuple[Candidate, ...]:
    """The serial ports of the computer itself (pins, RS-232, Bluetooth), a board on one perhaps.

    Never opened unless named: something else may be wired to them, or the console.
    """
    found = []
    for port in sorted(sysfs.glob("*/device")):
        name = port.parent.name
        real = os.path.realpath(port)
        try:
            # The kernel shows places for ports that are not there.
            there = int((port.parent / "type").read_text(encoding="ascii")) != 0
        except (OSError, ValueError):
            there = name.startswith("rfcomm")
        if there and "/usb" not in real:
            found.append(
                Candidate(
                    path=f"/dev/{name}",
                    description="on the computer itself",
                    is_ch340=False,
                    by_path=None,
                )
            )
    return tuple(found)


def choose(configured: str, found: Iterable[Candidate], *, udev_name: str = UDEV_NAME) -> str:
    """The port to open.

    Args:
        configured: ``serial.port``; empty to search.
        udev_name: The name that the udev rule gives the board.

    Raises:
        PortMissing: Nothing looks like a board.
        ConfigError: Several do, and only a person can say which.
    """
    if configured:
        return configured
    if os.path.exists(udev_name):
        return udev_name
    ports = tuple(found)
    boards = [each for each in ports if each.is_ch340]
    if len(boards) == 1:
        return boards[0].path
    if boards:
        names = ", ".join(each.by_path or each.path for each in boards)
        raise ConfigError(
            f"serial.port is empty and several ports could be the board: {names}.",
            remedy="Name the one to use: --port PATH, or serial.port in config.toml.",
        )
    others = ", ".join(f"{each.path} ({each.description})" for each in ports)
    hint = without_driver()
    raise PortMissing(
        f"no {udev_name} and no CH340 on USB"
        + (f"; other ports: {others}" if others else "")
        + ".",
        remedy=hint or "Plug the board in, or name its port: --port PATH.",
    )


def without_driver(sysfs: Path = Path("/sys/bus/usb/devices")) -> str:
    """The fault where a CH340 is on USB and no tty came of it; else empty."""
    for vendor in sorted(sysfs.glob("*/idVendor")):
        folder = vendor.parent
        try:
            ids = (int(vendor.read_text(), 16), int((folder / "idProduct").read_text(), 16))
        except (OSError, ValueError):
            continue
        if ids in CH340_IDS and not any(folder.glob("*/tty*")):
            drivers = sorted({link.resolve().name for link in folder.glob("*:*/driver")})
            if any("usbfs" in each for each in drivers):
                return (
                    "A CH340 is on USB, but another program took it from the kernel, most likely "
                    "brltty: sudo apt remove brltty, then plug the board in again."
                )
            return (
                "A CH340 is on USB, but the kernel made no tty of it: its ch341 driver is missing "
                "(some Jetson kernels lack it). Try: sudo modprobe ch341; docs/install.md says how "
                "to build it."
            )
    return ""


def _by_path(device: str) -> str | None:
    folder = Path("/dev/serial/by-path")
    try:
        for link in sorted(folder.iterdir()):
            if os.path.realpath(link) == os.path.realpath(device):
                return str(link)
    except OSError:
        pass
    return None
