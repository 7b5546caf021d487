"""``yahboomd run``: the daemon."""

from __future__ import annotations

import argparse
import asyncio
import logging
import os
import sys

from yahboomd.cli.options import add_config_options, add_port_option, read_config

DESCRIPTION = """\
Own the board's serial port, drive its wheels from velocity commands on the Zenoh bus, and publish
pose, twist, wheels, battery, status and events. It runs until SIGTERM, SIGINT or SIGHUP and stops
the wheels first. A board that is not there is waited for.
"""

EPILOG = """\
examples:
  yahboomd run                                   the only board on USB, default settings
  yahboomd run --port /dev/ttyUSB0 --config robot.toml
  yahboomd run --port /tmp/board --set chassis.wheel_separation_m=0.2

On the same machine, Zenoh clients reach the daemon at tcp/127.0.0.1:7448.
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "run",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_port_option(parser)
    add_config_options(parser)
    parser.add_argument(
        "--namespace", metavar="NAME", help="prefix of every key, short for --set zenoh.namespace="
    )


def run(args: argparse.Namespace) -> int:
    """Run until told to stop.

    Raises:
        ConfigError: The configuration cannot be used.
        BusError: The Zenoh session cannot be opened.
    """
    loaded = read_config(args)
    from yahboomd.daemon.logs import configure, flush
    from yahboomd.daemon.service import Daemon

    configure(loaded.config.log.level, os.environ, sys.stderr)
    log = logging.getLogger("yahboomd")
    for warning in loaded.warnings:
        log.warning("%s", warning)

    async def main() -> int:
        daemon = Daemon(loaded.config, environ=os.environ)
        status = os.EX_OK
        try:
            await daemon.run()
        except BaseExceptionGroup:
            # A mistake of ours, not of the user: the whole of it belongs into the log.
            log.critical("yahboomd failed; the wheels were told to stop", exc_info=True)
            status = os.EX_SOFTWARE
        if not daemon.left_clean:
            log.warning("the bus does not close; the wheels are stopped, and the process ends here")
            flush()
            os._exit(status)
        return status

    try:
        return asyncio.run(main())
    finally:
        flush()
