"""Searches this machine for the board's port, for a command without a daemon.

Slow modules are imported at their first use: see :mod:`yahboomd.core.link.seize`.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Awaitable
from pathlib import Path
from typing import TYPE_CHECKING

from yahboomd.core.link import discovery
from yahboomd.core.link.discovery import Candidate
from yahboomd.core.program import readable

if TYPE_CHECKING:
    from yahboomd.core.config import Config
    from yahboomd.core.link.port import Port, PortOptions


def find_port(config: Config) -> str:
    """The port to open; other ports that could be the board's are described on stderr.

    Raises:
        LinkError: There is none, or no board answers on any.
        ConfigError: Boards answer on several.
    """
    port = config.serial.port
    found = () if port else discovery.candidates()
    if sum(each.is_ch340 for each in found) < 2:
        return discovery.choose(port, found)
    import asyncio

    from yahboomd.core.clock import SystemClock
    from yahboomd.core.link.port import open_port

    clock = SystemClock()

    def open_it(path: str) -> Awaitable[Port]:
        return open_port(port_options(path, config), clock)

    path, others = asyncio.run(discovery.find(port, found, open_it, clock))
    print(f"yahboomd: {readable(others)}", file=sys.stderr)
    return path


def port_options(path: str, config: Config) -> PortOptions:
    """How the configuration opens a port."""
    from yahboomd.core.link.port import PortOptions

    serial = config.serial
    return PortOptions(
        path=path,
        baudrate=serial.baudrate,
        dtr=serial.dtr,
        rts=serial.rts,
        hangup_on_close=serial.hangup_on_close,
        relay=config.guard.relay,
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
