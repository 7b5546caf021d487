"""Connects a command to its robot, and ends it in order on signals and when its output is lost."""

from __future__ import annotations

import argparse
import asyncio
import logging
import select
import signal
import sys
from collections.abc import Awaitable, Callable, Iterable
from contextlib import contextmanager
from typing import TYPE_CHECKING

from yahboomd.cli.shared_options import (
    add_bus_options,
    add_config_options,
    daemon_endpoints,
    read_config,
    seconds,
)
from yahboomd.core.errors import NoDaemon
from yahboomd.tools.robot.daemon_address import client_options
from yahboomd.tools.stop.unresponsive import suspended, suspended_listener

if TYPE_CHECKING:
    from collections.abc import Iterator

    from yahboomd.client import AsyncRobot

WAIT_S = 5.0


def add_robot_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--timeout``, and the options that name the daemon."""
    parser.add_argument(
        "--timeout",
        metavar="SECONDS",
        type=seconds,
        default=WAIT_S,
        help="how long to wait for a daemon (default: %(default)s)",
    )
    add_bus_options(parser)
    add_config_options(parser)


def attend(
    args: argparse.Namespace,
    work: Callable[[AsyncRobot], Awaitable[int]],
    *,
    source: str | None = None,
    signals: Iterable[int] = (),
    quiet: bool = True,
) -> int:
    """Run a command's work on the robot that the shared options describe.

    Args:
        args: Parsed by a parser with :func:`add_robot_options`.
        source: The key to command on; None for the default, which may be the person's own.
        signals: Signals that end it too, besides SIGINT, SIGTERM and SIGHUP.

    Returns:
        The result of ``work``; after a signal, 128 and its number.

    Raises:
        NoDaemon: No daemon is there.
    """
    config = read_config(args).config
    from yahboomd.client import AsyncRobot

    endpoints = daemon_endpoints(args, config)
    robot = AsyncRobot(
        client_options(endpoints, config),
        source=source,
        label=f"yahboomd {args.command}",
        wait_s=args.timeout,
    )
    log = logging.getLogger("yahboomd")
    level = log.level
    if quiet:
        log.setLevel(logging.CRITICAL)
    try:
        return asyncio.run(_attended(robot, work, tuple(signals)))
    except NoDaemon as error:
        raise _explained(error, endpoints, f"yahboomd {args.command}") from error
    finally:
        log.setLevel(level)


def _explained(error: NoDaemon, endpoints: tuple[str, ...], again: str) -> NoDaemon:
    """The same error, or one that names a suspended daemon of this machine."""
    pid = suspended_listener(endpoints)
    if pid is None:
        return error
    message, remedy = suspended(pid, again)
    return NoDaemon(message, remedy=remedy)


async def _attended(
    robot: AsyncRobot, work: Callable[[AsyncRobot], Awaitable[int]], signals: tuple[int, ...]
) -> int:
    async def connected() -> int:
        async with robot:
            return await work(robot)

    return await until_signal(connected(), signals)


async def until_signal(work: Awaitable[int], signals: Iterable[int]) -> int:
    """Cancel the work at a signal, or when the output is lost.

    Returns:
        The work's result; after a signal, 128 and its number.
    """
    loop, task = asyncio.get_running_loop(), asyncio.current_task()
    came: list[int] = []

    def end(number: int) -> None:
        if not came and task is not None:
            came.append(number)
            task.cancel(signal.Signals(number).name)

    for number in signals:
        loop.add_signal_handler(number, end, number)
    try:
        with output_watched(lambda: end(signal.SIGPIPE)):
            return await work
    except asyncio.CancelledError:
        if not came:
            raise
        return 128 + came[0]


@contextmanager
def output_watched(gone: Callable[[], None]) -> Iterator[None]:
    """Call ``gone`` once when the reader of standard output leaves: a pipe's, or a terminal's.

    A command that prints nothing would not notice, for example after a lost SSH connection. Files
    are not watched.
    """
    loop = asyncio.get_running_loop()
    with select.epoll() as watch:
        try:
            # With an empty mask epoll still reports errors and hang-ups.
            watch.register(sys.stdout.fileno(), 0)
        except (OSError, ValueError, AttributeError):
            yield
            return

        def left() -> None:
            loop.remove_reader(watch.fileno())
            gone()

        loop.add_reader(watch.fileno(), left)
        try:
            yield
        finally:
            loop.remove_reader(watch.fileno())
