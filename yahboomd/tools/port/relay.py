"""The relay in the motors' supply: a line of a GPIO chip that the guard toggles.

A circuit holds the relay for as long as the line toggles: docs/relay.md. A level alone holds
nothing, since a line may keep it when the program that set it has ended, or the kernel hangs.
"""

from __future__ import annotations

import fcntl
import os
import struct
import threading
import time
from collections.abc import Callable

from yahboomd.tools.stop.last_stop import say

HALF_PERIOD_S = 0.05
HEARD_MS = 1000
"""A board is mute that sent no counts for as long: by then the wheels of a stop stand."""

NOT_HAD = (
    "{where}, the line of the relay (guard.relay), cannot be had: {why}. The motors have no "
    "supply; the guard goes on trying."
)

# The kernel's interface to GPIO chips, version 2: linux/gpio.h.
_REQUEST = struct.Struct("=I252x32sQ264xI24xi")
_GET_LINE = 0xC250B407
_SET_VALUES = 0xC010B40F
_OUTPUT = 1 << 3


def start(where: str, heard_ms: Callable[[], int | None]) -> None:
    """Toggle a line in a thread of its own, since the guard looks at wheels for seconds.

    Args:
        where: The chip's device and the line's offset, such as ``/dev/gpiochip0:17``.
        heard_ms: When the board's newest counts came; None while the guard has no port.
    """
    threading.Thread(target=_run, args=(where, heard_ms), name="relay", daemon=True).start()


def _run(where: str, heard_ms: Callable[[], int | None]) -> None:
    said = False
    while True:
        try:
            _toggle(_output(where), heard_ms)
        except OSError as error:
            # A guard before this one may have the line, or the chip is away.
            if not said:
                said = True
                say(NOT_HAD.format(where=where, why=error.strerror))
        time.sleep(1.0)


def _toggle(line: int, heard_ms: Callable[[], int | None]) -> None:
    level = 0
    try:
        while True:
            time.sleep(HALF_PERIOD_S)
            level = next_level(level, heard_ms(), time.monotonic_ns() // 1_000_000)
            fcntl.ioctl(line, _SET_VALUES, struct.pack("=QQ", level, 1))
    finally:
        os.close(line)


def next_level(level: int, heard_ms: int | None, now_ms: int) -> int:
    """The other level while the board is heard; low once it is not.

    Args:
        heard_ms: When its newest counts came; None without a port.
    """
    return int(not level and heard_ms is not None and now_ms - heard_ms < HEARD_MS)


def _output(where: str) -> int:
    """Take a line as an output that is low.

    Raises:
        OSError: It cannot be had.
    """
    path, _, offset = where.rpartition(":")
    request = bytearray(_REQUEST.pack(int(offset), b"yahboomd-guard", _OUTPUT, 1, -1))
    chip = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    try:
        fcntl.ioctl(chip, _GET_LINE, request)
    finally:
        os.close(chip)
    line: int = _REQUEST.unpack(request)[-1]
    return line
