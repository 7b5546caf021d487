"""Finds a gamepad, reads it, and waits for another one when it is unplugged."""

from __future__ import annotations

import asyncio
import errno
import fcntl
import os
import stat
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Self

from yahboomd.core.clock import Clock
from yahboomd.tools.screens.gamepad import (
    AXES,
    EV_ABS,
    EV_KEY,
    SOUTH,
    STICK_X,
    STICK_Y,
    AxisRange,
    Gamepad,
    PadWish,
)

FOLDER = Path("/dev/input")

LOOK_NS = 1_000_000_000

READ_BYTES = 4096
NAME_BYTES = 128
BITS_BYTES = 96
"""One bit for each key: linux/input-event-codes.h ends at 0x2ff."""

USE = "hold a shoulder button and push the left stick; east (B) is the emergency stop"


def _ioc(number: int, size: int) -> int:
    """The number of an ioctl that reads, of asm-generic/ioctl.h, for the kernel's input devices."""
    return (2 << 30) | (size << 16) | (ord("E") << 8) | number


class GamepadPort:
    """The connected gamepad, if any, on the running loop. A context manager.

    Args:
        device: The only device to use; None: the first in ``/dev/input``.
        reads: Called before the records of each read are processed.
        wanted: Called with each wish, once the state is up to date.
        moved: Called after each read.
        lost: Called when the pad is gone.

    Attributes:
        words: The state of the pad, for people.
    """

    def __init__(
        self,
        device: Path | None,
        clock: Clock,
        *,
        reads: Callable[[], None],
        wanted: Callable[[PadWish], None],
        moved: Callable[[], None],
        lost: Callable[[], None],
        folder: Path = FOLDER,
    ) -> None:
        self.pad: Gamepad | None = None
        self.words = ""
        self._device = device
        self._folder = folder
        self._clock = clock
        self._reads = reads
        self._wanted = wanted
        self._moved = moved
        self._lost = lost
        self._fd: int | None = None
        self._look_ns = 0

    def __enter__(self) -> Self:
        self.look()
        return self

    def __exit__(self, *_: object) -> None:
        self._close()

    def look(self) -> None:
        """Look for a pad, once a second while there is none."""
        now_ns = self._clock.now_ns()
        if self.pad is not None or now_ns < self._look_ns:
            return
        self._look_ns = now_ns + LOOK_NS
        denied: Path | None = None
        for path in self._candidates():
            try:
                fd = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
            except OSError as error:
                if error.errno in {errno.EACCES, errno.EPERM}:
                    denied = denied or path
                continue
            if self._device is not None or _is_gamepad(fd):
                self._open(fd, path)
                return
            os.close(fd)
        self.words = self._nothing(denied)

    def _candidates(self) -> list[Path]:
        if self._device is not None:
            return [self._device]
        found = self._folder.glob("event*")
        return sorted(found, key=lambda path: (len(path.name), path.name))

    def _nothing(self, denied: Path | None) -> str:
        if denied is not None:
            return (
                f"Your user may not read {denied}. Type `sudo usermod -aG input $USER`, then log "
                "out and in again."
            )
        if self._device is None and (others := sorted(self._folder.glob("js*"))):
            return (
                f"To the kernel {others[0]} is a joystick, not a gamepad: which of its buttons "
                "would be held is unknown. Many pads have another mode, by a switch or a button "
                "that is held while it connects."
            )
        where = f"{self._device} is not there" if self._device else "No gamepad is there"
        return f"{where}: plug it in, or connect it. It is found by itself."

    def _open(self, fd: int, path: Path) -> None:
        self._fd = fd
        self.pad = Gamepad(_ranges(fd))
        self.words = f"{_name(fd) or path}: {USE}."
        asyncio.get_running_loop().add_reader(fd, self._read)

    def _read(self) -> None:
        if self._fd is None or self.pad is None:
            return
        try:
            data = os.read(self._fd, READ_BYTES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._close()
            self.words = "The gamepad is gone, and the robot stops. The pad is waited for."
            self._look_ns = self._clock.now_ns() + LOOK_NS
            self._lost()
            return
        self._reads()
        for each in self.pad.feed(data):
            self._wanted(each)
        self._moved()

    def _close(self) -> None:
        fd, self._fd, self.pad = self._fd, None, None
        if fd is not None:
            asyncio.get_running_loop().remove_reader(fd)
            os.close(fd)


def _ask(fd: int, number: int, size: int) -> bytes:
    """Read by an ioctl; empty if the file is not an input device."""
    if not stat.S_ISCHR(os.fstat(fd).st_mode):
        return b""
    try:
        return fcntl.ioctl(fd, _ioc(number, size), bytes(size))
    except OSError:
        return b""


def _has(bits: bytes, number: int) -> bool:
    return number // 8 < len(bits) and bool(bits[number // 8] >> number % 8 & 1)


def _is_gamepad(fd: int) -> bool:
    keys = _ask(fd, 0x20 + EV_KEY, BITS_BYTES)
    axes = _ask(fd, 0x20 + EV_ABS, BITS_BYTES)
    return _has(keys, SOUTH) and _has(axes, STICK_X) and _has(axes, STICK_Y)


def _name(fd: int) -> str:
    name = _ask(fd, 0x06, NAME_BYTES).split(b"\0")[0].decode("utf-8", "replace")
    return "".join(letter for letter in name if letter.isprintable())


def _ranges(fd: int) -> dict[int, AxisRange]:
    found: dict[int, AxisRange] = {}
    for axis in AXES:
        answer = _ask(fd, 0x40 + axis, 24)
        if len(answer) == 24:
            _, least, most, *_ = struct.unpack("6i", answer)
            found[axis] = AxisRange(least, most)
    return found
