"""``yahboomd metrics``: serves a robot's counters to Prometheus, in a process of its own."""

from __future__ import annotations

import argparse
import asyncio
import os
import signal
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

from yahboomd import __version__
from yahboomd.cli.shared_options import (
    add_connect_option,
    add_set_option,
    daemon_options,
    read_config,
)
from yahboomd.core.errors import ConfigError

if TYPE_CHECKING:
    from yahboomd.core.bus.options import BusOptions
    from yahboomd.tools.metrics.http_listener import Place
    from yahboomd.tools.metrics.robot_poll import RobotPoll

DEFAULT_PLACE = "127.0.0.1:9448"
REPORT_S = 1.0

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

DESCRIPTION = """\
Serve everything that the daemon counts, as OpenMetrics for Prometheus: state, emergency stop, line,
commands, bus, battery, speeds, events. It is an ordinary client of the bus that asks the daemon
once a second, however often it is scraped, and only reads. Only this machine reaches the page.
"""

EPILOG = """\
examples:
  yahboomd metrics                                      the daemon on this machine
  curl http://127.0.0.1:9448/metrics                    the metrics as text
  yahboomd metrics --config /etc/yahboomd/front.toml --config /etc/yahboomd/rear.toml
                                                        two boards, each with its own file
  yahboomd metrics --namespace bot1 --namespace bot2 --connect tcp/192.168.1.5:7447
                                                        two robots that a router there knows

As a service: sudo systemctl enable --now yahboomd-metrics. docs/metrics.md has the dashboard.
Ctrl-C ends it.

exit status:
  0    you ended it
  69   the address is taken, or the bus can never be reached like this
  78   a mistake in the configuration, or an address that other machines reach without --expose
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        "--listen",
        metavar="ADDRESS:PORT",
        default=DEFAULT_PLACE,
        help="where scrapers ask (default: %(default)s); port 0 for any free one",
    )
    parser.add_argument(
        "--expose",
        action="store_true",
        help="allow an address that other machines reach: everybody there reads the metrics, "
        "without password or encryption",
    )
    parser.add_argument(
        "--host-name",
        metavar="NAME",
        action="append",
        default=[],
        help="a name by which scrapers may ask, besides addresses and localhost; may be repeated",
    )
    add_connect_option(parser)
    parser.add_argument(
        "--namespace",
        metavar="NAME",
        action="append",
        help="name of the robot, short for --set zenoh.namespace=NAME; repeated: several robots",
    )
    parser.add_argument(
        "--config",
        metavar="FILE",
        type=Path,
        action="append",
        help="the daemon's configuration (default: /etc/yahboomd/config.toml, if it exists); "
        "repeated: several robots",
    )
    add_set_option(parser)


def run(args: argparse.Namespace) -> int:
    """Serve until a signal ends it."""
    from yahboomd.tools.metrics.http_listener import Place

    place = Place.of(args.listen)
    if place is None:
        raise ConfigError(
            f"--listen {args.listen} is no address and port of this machine.",
            remedy=f"Such as {DEFAULT_PLACE}, or [::1]:9448.",
        )
    if not place.is_loopback and not args.expose:
        raise ConfigError(
            f"At {place} every program on the network could read the metrics, without password or "
            "encryption. Nothing is served.",
            remedy=f"Listen on {DEFAULT_PLACE} and let Prometheus, or a proxy with TLS, run on "
            "this machine; or add --expose if everybody on that network may read them.",
        )
    return asyncio.run(_serve(_robots(args), place, args.host_name))


def _robots(args: argparse.Namespace) -> dict[str, BusOptions]:
    """The options to reach each robot, by its name."""
    robots: dict[str, BusOptions] = {}
    for file, namespace in product(args.config or [None], args.namespace or [None]):
        one = argparse.Namespace(**{**vars(args), "config": file, "namespace": namespace})
        config = read_config(one).config
        name = config.zenoh.namespace or "yahboomd"
        if name in robots:
            raise ConfigError(
                f"Two robots are called {name!r}: their metrics would be mixed up.",
                remedy="Each needs a zenoh.namespace of its own.",
            )
        robots[name] = daemon_options(args, config)
    return robots


async def _serve(robots: dict[str, BusOptions], place: Place, names: list[str]) -> int:
    from yahboomd.core.clock import SystemClock
    from yahboomd.tools.metrics.http_listener import PATH, MetricsListener
    from yahboomd.tools.metrics.robot_metrics import Page
    from yahboomd.tools.metrics.robot_poll import RobotPoll

    ended = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in SIGNALS:
        loop.add_signal_handler(number, ended.set)
    clock = SystemClock()
    polls = [RobotPoll(name, options, clock) for name, options in robots.items()]
    page = Page(clock.now_ns, lambda: [poll.current() for poll in polls], version=__version__)
    tasks: list[asyncio.Task[None]] = []
    try:
        async with MetricsListener(place, page.text, names=names) as listener:
            page.connections = listener.outcomes
            tasks += [asyncio.create_task(each.run(), name=f"poll-{each.name}") for each in polls]
            print(f"Metrics at http://{listener.place}{PATH}", flush=True)
            for name, options in robots.items():
                print(f"{name}: asked at {', '.join(options.connect)}", flush=True)
            await _report(polls, tasks, ended)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    return os.EX_OK


async def _report(
    polls: list[RobotPoll], tasks: list[asyncio.Task[None]], ended: asyncio.Event
) -> None:
    """Print when a daemon comes or goes, until the end; raises if one can never be reached."""
    alive = {poll.name: False for poll in polls}
    while not ended.is_set():
        for task in tasks:
            if task.done():
                task.result()
        for poll in polls:
            facts = poll.current()
            if alive[poll.name] != (facts.status is not None):
                alive[poll.name] = facts.status is not None
                words = "its daemon answers" if facts.status else "its daemon has gone silent"
                print(f"{poll.name}: {words}", flush=True)
        try:
            async with asyncio.timeout(REPORT_S):
                await ended.wait()
        except TimeoutError:
            continue
