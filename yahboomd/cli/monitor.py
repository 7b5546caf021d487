"""``yahboomd monitor``: watches a running daemon."""

from __future__ import annotations

import argparse
import asyncio
import os
import signal
import sys
from contextlib import ExitStack
from typing import TYPE_CHECKING

from yahboomd.cli.shared_options import (
    add_bus_options,
    add_config_options,
    daemon_options,
    read_config,
    seconds,
)
from yahboomd.core.errors import BusError

if TYPE_CHECKING:
    from yahboomd.core.bus.options import BusOptions
    from yahboomd.core.clock import Clock
    from yahboomd.tools.screens.dashboard import View
    from yahboomd.tools.screens.feed import Feed

REDRAW_S = 0.1
CALM_S = 0.5
"""The period of updates while nothing moves; a status or an event is shown at once."""

LINE_S = 1.0
COMPLETE_S = 1.0
"""The time for which ``--once`` waits for a pose, and for two statuses to compute rates from."""

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

DESCRIPTION = """\
Watch a running daemon: its state and why the robot stands, who drives, pose, twist, wheels,
battery, the quality of the line to the board, and events. It only listens: nothing that happens
here moves a wheel. If no daemon is there, it waits for one.
"""

EPILOG = """\
examples:
  yahboomd monitor                                   the daemon on this machine
  yahboomd monitor --connect tcp/192.168.1.5:7447    one that a router there knows
  yahboomd monitor --once                            one look, for scripts and bug reports

Late beats are polls that came late because the robot's computer was busy.
q or Ctrl-C ends it.

exit status:
  0    you ended it, or --once has printed everything
  69   --once found no daemon, or the bus can never be reached like this
  78   a mistake in the configuration
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--once", action="store_true", help="print everything once, and end")
    form.add_argument(
        "--plain",
        action="store_true",
        help="print lines instead of a screen, as without a terminal: each second, for each change "
        "of state, and for each event",
    )
    parser.add_argument(
        "--timeout",
        metavar="S",
        type=seconds,
        default=5.0,
        help="how long --once waits for a daemon, in seconds (default: %(default)s)",
    )
    add_bus_options(parser)
    add_config_options(parser)


def run(args: argparse.Namespace) -> int:
    """Watch until a person or a signal ends it."""
    on_screen = (
        not args.once
        and not args.plain
        and sys.stdout.isatty()
        and os.environ.get("TERM", "dumb") != "dumb"
    )
    if on_screen:
        # Imported first, so that a missing package is reported before anything is opened.
        import rich  # noqa: F401
    config = read_config(args).config

    options = daemon_options(args, config)
    once_s = args.timeout if args.once else None
    return asyncio.run(_run(options, once_s=once_s, on_screen=on_screen))


async def _run(options: BusOptions, *, once_s: float | None, on_screen: bool) -> int:
    from yahboomd.core.clock import SystemClock
    from yahboomd.tools.screens.feed import Feed

    clock = SystemClock()
    ended = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in SIGNALS:
        loop.add_signal_handler(number, ended.set)
    async with Feed(options, clock) as feed:
        if once_s is not None:
            return await _once(feed, clock, ended, once_s)
        await (_on_screen if on_screen else _lines)(feed, clock, ended)
    return os.EX_OK


async def _pause(s: float, *events: asyncio.Event) -> None:
    """Wait, at most until one of these events."""
    waits = [asyncio.ensure_future(event.wait()) for event in events]
    try:
        await asyncio.wait(waits, timeout=s, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for wait in waits:
            wait.cancel()


async def _once(feed: Feed, clock: Clock, ended: asyncio.Event, within_s: float) -> int:
    from yahboomd.core.clock import nanoseconds
    from yahboomd.tools.screens import sentences

    until_ns = clock.now_ns() + nanoseconds(within_s)
    seen_ns: int | None = None
    while not ended.is_set():
        feed.check()
        now_ns = clock.now_ns()
        view = feed.view(now_ns)
        if view.status is not None:
            seen_ns = now_ns if seen_ns is None else seen_ns
            if _complete(view) or now_ns - seen_ns > nanoseconds(COMPLETE_S):
                print(sentences.snapshot(view, where=feed.robot))
                return os.EX_OK
        elif now_ns > until_ns:
            raise BusError(
                f"No daemon answered at {feed.wanted} within {within_s:g} s.",
                remedy=feed.why,
            )
        await _pause(0.05, ended)
    return 128 + signal.SIGINT


def _complete(view: View) -> bool:
    return (
        view.pose is not None and view.readings_per_s is not None and view.poses_per_s is not None
    )


async def _lines(feed: Feed, clock: Clock, ended: asyncio.Event) -> None:
    from yahboomd.core.clock import nanoseconds
    from yahboomd.tools.screens import sentences

    printed: object = None
    due_ns = clock.now_ns()
    while not ended.is_set():
        feed.check()
        feed.news.clear()
        now_ns = clock.now_ns()
        view = feed.view(now_ns)
        for event in feed.dashboard.new_events():
            print(sentences.event_line(event), flush=True)
        status = view.status
        if status is None:
            words = f"waiting for a daemon at {feed.wanted} … {feed.why}".rstrip()
            if words != printed:
                print(words, flush=True)
            printed = words
        elif now_ns >= due_ns or printed != (view.phase, status.state, status.driver):
            print(sentences.line(view), flush=True)
            printed = (view.phase, status.state, status.driver)
            due_ns = now_ns + nanoseconds(LINE_S)
        await _pause(CALM_S, ended, feed.news)


async def _on_screen(feed: Feed, clock: Clock, ended: asyncio.Event) -> None:
    from yahboomd.tools.screens import monitor_screen
    from yahboomd.tools.screens.drawing import Screen
    from yahboomd.tools.screens.keyboard import Keys
    from yahboomd.tools.screens.teleop import wish

    def pressed(key: str) -> None:
        if wish(key) == "quit":
            ended.set()

    with ExitStack() as stack:
        if sys.stdin.isatty():
            # This also keeps typed keys from appearing among the numbers.
            stack.enter_context(Keys(sys.stdin.fileno(), pressed, ended.set))
        screen = stack.enter_context(Screen(sys.stdout.fileno(), ended.set))
        while not ended.is_set():
            feed.check()
            feed.news.clear()
            view = feed.view(clock.now_ns())
            if view.status is None:
                screen.draw(monitor_screen.waiting(view, where=feed.wanted, why=feed.why))
            else:
                width, height = screen.size
                screen.draw(
                    monitor_screen.screen(view, where=feed.robot, width=width, height=height)
                )
            if view.moving:
                await _pause(REDRAW_S, ended)
            else:
                await _pause(CALM_S, ended, feed.news)
