"""``yahboomd stop``: the wheels stand when it ends, whoever drove them.

Nothing is imported here that ``--help`` does not need: with ``--port`` the first stop is on the
wire before asyncio, pydantic and Zenoh are loaded.
"""

from __future__ import annotations

import argparse
import os
from typing import TYPE_CHECKING

from yahboomd.cli.options import (
    add_bus_options,
    add_config_options,
    add_port_option,
    daemon_endpoints,
    read_config,
)
from yahboomd.cli.stop_port import (
    configuration,
    needs_no_configuration,
    take,
    take_noted,
    tell,
    undisturbed,
)
from yahboomd.errors import ConfigError, LinkError, PortBusy, YahboomdError
from yahboomd.link.seize import Seized

if TYPE_CHECKING:
    from yahboomd.cli.stop_client import BusStop
    from yahboomd.config import Config
    from yahboomd.link.takeover import TakeoverReport

NOT_STANDING = 1
"""The exit status where the wheels were not shown to stand."""

DESCRIPTION = """\
Stop the wheels, and see that they stand. A running daemon is told to engage its emergency stop,
which it keeps until it is released. Where no daemon holds the port, the port itself is taken: the
board is stopped, its counters are watched until the wheels stand, and its motors are let go.
"""

EPILOG = """\
examples:
  yahboomd stop                        whatever drives
  yahboomd stop --release              let a stopped daemon drive again
  yahboomd stop --connect tcp/192.168.1.5:7447
                                       a daemon on another machine
  yahboomd stop --direct --port /dev/yahboom_driver
                                       after a daemon was killed: ExecStopPost= of a service

exit status: 0 the wheels stand; 1 they were stopped, and not seen to stand; 69 no port or no
daemon; 77 no permission.
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "stop",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    how = parser.add_mutually_exclusive_group()
    how.add_argument(
        "--direct",
        action="store_true",
        help="on the port only, and at once: ask no daemon. With --port no configuration is read "
        "unless --config or --set is given. A held port is tried again for a second",
    )
    how.add_argument(
        "--release",
        action="store_true",
        help="release the daemon's emergency stop, and clear a fault (refused while something "
        "commands motion)",
    )
    add_port_option(parser)
    add_bus_options(parser)
    add_config_options(parser)


def run(args: argparse.Namespace) -> int:
    """Stop, or release the emergency stop.

    Returns:
        0 where the wheels were seen to stand, 1 where they were stopped and not seen to.

    Raises:
        LinkError: No daemon answers, and the port cannot be used.
        BusError: Only a daemon was asked for, and none answers; or it refuses the release.
    """
    if args.release:
        from yahboomd.cli.stop_client import release

        config = read_config(args).config
        print(release(daemon_endpoints(args, config), config))
        return os.EX_OK
    if args.connect:
        return _status(_bus(args))
    with undisturbed():
        return _status(_direct(args) if args.direct else _everywhere(args))


def _status(stood: bool) -> int:
    return os.EX_OK if stood else NOT_STANDING


def _direct(args: argparse.Namespace) -> bool:
    seized = take_noted(args)
    if seized is not None:
        return tell(_on_port(seized))
    config = None if needs_no_configuration(args) else configuration(args)
    return tell(_on_port(take(args, config)))


def _bus(args: argparse.Namespace) -> bool:
    config = configuration(args)
    endpoints = daemon_endpoints(args, config)
    _, answer = _stop(None, config, endpoints)
    if answer is None:
        from yahboomd.cli.stop_client import nobody

        raise nobody(endpoints)
    print(answer.words)
    return answer.stood


def _everywhere(args: argparse.Namespace) -> bool:
    """The port at once where it is free, and the daemon's emergency stop where there is one."""
    config = None if needs_no_configuration(args) else configuration(args)
    seized: Seized | None = None
    trouble: YahboomdError | None = None
    try:
        seized = take(args, config, patience_s=0.0)
    except (LinkError, ConfigError) as error:
        trouble = error
    config = config or configuration(args)
    endpoints = daemon_endpoints(args, config)
    report, answer = _stop(seized, config, endpoints)
    if answer is not None:
        print(answer.words)
        return answer.stood if report is None else tell(report)
    if report is None:
        if not isinstance(trouble, PortBusy):
            assert trouble is not None
            namespace = config.zenoh.namespace
            below = f" below the namespace {namespace!r}" if namespace else ""
            raise type(trouble)(
                f"No daemon answers at {' or '.join(endpoints)}{below}, and {trouble.message}",
                remedy=trouble.remedy,
            ) from trouble
        # Nobody on the bus: whoever held the port may have been about to end.
        report = _on_port(take(args, config, asked=endpoints))
    return tell(report)


def _on_port(seized: Seized) -> TakeoverReport:
    report, _ = _stop(seized, None)
    assert report is not None
    return report


def _stop(
    seized: Seized | None, config: Config | None, endpoints: tuple[str, ...] = ()
) -> tuple[TakeoverReport | None, BusStop | None]:
    """Stop on the port, if it was taken, and on the bus, if a configuration is given."""
    import asyncio

    async def on_port() -> TakeoverReport | None:
        if seized is None:
            return None
        from yahboomd.clock import SystemClock
        from yahboomd.link.seized import SeizedPort
        from yahboomd.link.takeover import take_over

        clock = SystemClock()
        return await take_over(SeizedPort(seized, clock), clock, spoken_ns=seized.spoken_ns)

    async def on_bus() -> BusStop | None:
        if config is None:
            return None
        from yahboomd.cli.stop_client import engage

        return await engage(endpoints, config)

    async def both() -> tuple[TakeoverReport | None, BusStop | None]:
        return await asyncio.gather(on_port(), on_bus())

    return asyncio.run(both())
