"""The latency timer of FTDI's USB-serial chips, which makes every answer late by default.

Such a chip keeps received bytes until its buffer is full or the timer is over: 16 ms unless
someone sets it. A CH340, which the board carries, has no such timer; a board on a level shifter of
another kind may.
"""

from __future__ import annotations

import os
from pathlib import Path

SYSFS = Path("/sys/bus/usb-serial/devices")

SHORTEST_MS = 1

RULE = (
    'ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", '
    f'ATTR{{latency_timer}}="{SHORTEST_MS}"'
)
"""The udev rule, to paste."""


def latency_ms(port: str) -> int | None:
    """The timer of a port; ``None`` if it has none."""
    name = os.path.basename(os.path.realpath(port))
    try:
        return int((SYSFS / name / "latency_timer").read_text(encoding="ascii"))
    except (OSError, ValueError):
        return None


def describe(port: str) -> str | None:
    """The effect of a timer that is longer than necessary, and the line that sets it.

    Returns:
        A sentence, and on a line of its own the udev rule; ``None`` if there is nothing to set.
    """
    timer_ms = latency_ms(port)
    if timer_ms is None or timer_ms <= SHORTEST_MS:
        return None
    return (
        f"{port}: its USB-serial chip keeps what it has received for up to {timer_ms} ms, so "
        "counts and answers come that much late. This line in "
        "/etc/udev/rules.d/60-latency.rules sets the timer when the port is plugged in again:\n"
        f"{RULE}"
    )
