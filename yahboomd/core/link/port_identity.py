"""The device behind a port's name. udev may give a name away; the device stays what it is.

Read by ``yahboomd stop`` before anything else, so it imports nothing but ``os``.
"""

from __future__ import annotations

import os
from typing import NamedTuple

SYSFS = "/sys"
DEV = "/dev"

_PSEUDO_TERMINALS = range(136, 144)
"""The major device numbers that Linux gives them."""
_NUMBERS_EACH = 256


class Device(NamedTuple):
    """A serial device, as far as the system can tell it from others.

    Attributes:
        number: Its device number; given again once it is free.
        node: The file system and inode of its node, of a pseudo-terminal its creation as well.
        usb: The USB socket, the vendor and product, and the serial number; empty if it is not
            on USB, or the system does not report it.
    """

    number: int
    node: str
    usb: str


def identify(status: os.stat_result, *, sysfs: str = SYSFS) -> Device:
    """The device of an open port, or of its path.

    Args:
        status: As from ``os.fstat`` or ``os.stat``.
    """
    node = f"{status.st_dev}:{status.st_ino}"
    if is_pseudo(status.st_rdev):
        node += f":{status.st_ctime_ns}"
    return Device(status.st_rdev, node, _usb(status.st_rdev, sysfs))


def same(noted: Device, found: Device) -> bool:
    if noted[:2] == found[:2]:
        return True
    if noted.usb or found.usb:
        # It dropped off the bus and came back to its socket.
        return noted.usb == found.usb
    # A soldered device keeps its number; that of a pseudo-terminal goes to the next one.
    return noted.number == found.number and not is_pseudo(noted.number)


def find(noted: Device, *, sysfs: str = SYSFS, dev: str = DEV) -> str | None:
    """A path of the device now; ``None`` if it is not there."""
    major, minor = os.major(noted.number), os.minor(noted.number)
    if is_pseudo(noted.number):
        number = (major - _PSEUDO_TERMINALS.start) * _NUMBERS_EACH + minor
        names = [f"pts/{number}"]
    else:
        names = [os.path.basename(os.path.realpath(f"{sysfs}/dev/char/{major}:{minor}"))]
    try:
        ports = sorted(os.listdir(f"{sysfs}/class/tty"))
    except OSError:
        ports = []
    names += [name for name in ports if name.startswith(("ttyUSB", "ttyACM"))]
    for path in (os.path.join(dev, name) for name in names):
        try:
            if same(noted, identify(os.stat(path), sysfs=sysfs)):
                return path
        except OSError:
            continue
    return None


def is_pseudo(number: int) -> bool:
    return os.major(number) in _PSEUDO_TERMINALS


def _usb(number: int, sysfs: str) -> str:
    """Socket, vendor:product and serial number of the USB device that a port belongs to."""
    place = os.path.realpath(f"{sysfs}/dev/char/{os.major(number)}:{os.minor(number)}")
    root = os.path.realpath(sysfs)
    while place.startswith(root + os.sep):
        vendor = _read(place, "idVendor")
        if vendor:
            ids = f"{vendor}:{_read(place, 'idProduct')}"
            return f"{os.path.basename(place)} {ids} {_read(place, 'serial')}".rstrip()
        place = os.path.dirname(place)
    return ""


def _read(folder: str, name: str) -> str:
    try:
        with open(os.path.join(folder, name), encoding="utf-8", errors="replace") as file:
            return file.read().strip()
    except OSError:
        return ""
