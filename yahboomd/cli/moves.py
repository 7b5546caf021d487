"""``yahboomd moves``: the service that drives moves to their goals, in a process of its own."""

from __future__ import annotations

import argparse
import asyncio
import os
import signal
from typing import TYPE_CHECKING

from yahboomd.cli.shared_options import (
    add_bus_options,
    add_config_options,
    daemon_options,
    read_config,
)

if TYPE_CHECKING:
    from yahboomd.core.bus.options import BusOptions
    from yahboomd.moves.move_service import MoveService

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

DESCRIPTION = """\
Serve moves: drive a metre, turn by a quarter, go to a place, follow a path. A client in any
language asks for them on the bus (yahboomd/moves/start) and stays there: it is heard ten times a
second, or the robot stops. `yahboomd move` and the Python client do so. It is an ordinary client
of the daemon, on cmd_vel/moves: every other source has precedence.
"""

EPILOG = """\
examples:
  yahboomd moves                                 for the daemon on this machine
  yahboomd move straight 1                       in another terminal
  yahboomd moves --connect tcp/192.168.1.5:7448  for a daemon on another machine

As a service: sudo systemctl enable --now yahboomd-moves. docs/moves.md has the rest.
Ctrl-C ends it; the robot stops.

exit status:
  0    you ended it
  1    another `yahboomd moves` serves this robot already
  69   the bus can never be reached like this
  78   a mistake in the configuration
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_bus_options(parser)
    add_config_options(parser)


def run(args: argparse.Namespace) -> int:
    """Serve until a signal ends it."""
    config = read_config(args).config
    return asyncio.run(_serve(daemon_options(args, config)))


async def _serve(options: BusOptions) -> int:
    from yahboomd.core.clock import SystemClock
    from yahboomd.moves.move_service import MoveService

    service = MoveService(options, SystemClock())
    serving = asyncio.create_task(service.run(), name="moves")
    reporting = asyncio.create_task(_report(service, ", ".join(options.connect)))
    loop = asyncio.get_running_loop()
    for number in SIGNALS:
        loop.add_signal_handler(number, serving.cancel)
    try:
        await asyncio.wait([serving])
        if not serving.cancelled():
            # The robot can never be reached like this.
            serving.result()
    finally:
        reporting.cancel()
        await asyncio.gather(reporting, return_exceptions=True)
    return os.EX_OK


async def _report(service: MoveService, where: str) -> None:
    """Print when the daemon comes or goes, and when moves are served."""
    alive: bool | None = None
    serving = False
    while True:
        await asyncio.sleep(0.25)
        if service.robot.alive != alive:
            alive = service.robot.alive
            words = "answers" if alive else "does not answer; it is waited for"
            print(f"yahboomd at {where} {words}.", flush=True)
        if service.serving and not serving:
            serving = True
            print(f"Moves are served at {where}.", flush=True)
