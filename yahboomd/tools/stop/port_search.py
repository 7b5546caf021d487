"""Searches this machine for the board's port, for a command without a daemon."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Awaitable
from pathlib import Path

from yahboomd.core.clock import SystemClock
from yahboomd.core.config import Config
from yahboomd.core.link import discovery
from yahboomd.core.link.discovery import Candidate
from yahboomd.core.link.port import Port, PortOptions, open_port
from yahboomd.core.program import readable


def find_port(config: Config) -> str:
    """The port to open; what is known of other ports that could be the board goes to stderr.

    Raises:
        LinkError: There is none, or no board answers on any.
        ConfigError: Boards answer on several.
    """
    serial, clock = config.serial, SystemClock()

    def open_it(path: str) -> Awaitable[Port]:
        return open_port(port_options(path, config), clock)

    found = () if serial.port else discovery.candidates()
    path, others = asyncio.run(discovery.find(serial.port, found, open_it, clock))
    if others:
        print(f"yahboomd: {readable(others)}", file=sys.stderr)
    return path


def port_options(path: str, config: Config) -> PortOptions:
    """How the configuration opens a port."""
    serial = config.serial
    return PortOptions(
        path=path,
        baudrate=serial.baudrate,
        dtr=serial.dtr,
        rts=serial.rts,
        hangup_on_close=serial.hangup_on_close,
    )


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
