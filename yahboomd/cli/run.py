"""``yahboomd run``: runs the daemon."""

from __future__ import annotations

import argparse
import asyncio
import logging
import os
import re
import sys
from functools import partial
from typing import TYPE_CHECKING

from yahboomd.cli.shared_options import add_config_options, add_port_option, read_config
from yahboomd.core.errors import BusConfigError, BusError
from yahboomd.tools.port import charge
from yahboomd.tools.stop.last_stop import say
from yahboomd.tools.stop.unresponsive import FROZEN, is_yahboomd, process_state

if TYPE_CHECKING:
    from yahboomd.core.config import Config
    from yahboomd.core.link.port_guard import PortGuard

DESCRIPTION = """\
Own the board's serial port, drive its wheels from velocity commands on the Zenoh bus, and publish
pose, twist, wheels, battery, status and events. It runs until SIGTERM, SIGINT or SIGHUP and stops
the wheels first, as on any signal but SIGKILL, SIGSTOP, and those of a fault of the program
(SIGSEGV, SIGBUS, SIGILL, SIGFPE, SIGABRT, SIGSYS, SIGTRAP): after these its guard stops them. A
board that is not there is waited for.

The guard is a small process that shares the open port. It also stops the wheels if the daemon
pauses for 0.5 s, and kills one that hangs, or is suspended by SIGSTOP, for 5 s.
"""

EPILOG = """\
examples:
  yahboomd run                                   the only board on USB, default settings
  yahboomd run --port /dev/ttyUSB0 --config robot.toml
  yahboomd run --port /tmp/board --set chassis.wheel_separation_m=0.2

On the same machine, Zenoh clients reach the daemon at tcp/127.0.0.1:7448.

exit status:
  0    ended by SIGTERM, SIGINT or SIGHUP; the wheels were seen to stand
  69   the bus cannot be opened
  70   a fault of yahboomd; a stop was sent to the wheels
  71   the system allows this process too few files or threads, or too little memory
  75   ended, and the wheels were not seen to stand: look at them
  78   a mistake in the configuration
Any other signal that ends it ends it by that signal, once the wheels were stopped.
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_port_option(parser)
    add_config_options(parser)
    parser.add_argument(
        "--no-guard",
        action="store_true",
        help="start no process that stops the wheels if this one is killed or freezes: for "
        "debuggers",
    )
    parser.add_argument(
        "--namespace", metavar="NAME", help="prefix of every key, short for --set zenoh.namespace="
    )


def run(args: argparse.Namespace) -> int:
    """Run until a signal ends it."""
    guard = None if args.no_guard else _start_guard()
    try:
        return _serve(args, guard)
    finally:
        if guard is not None:
            guard.end()


def _serve(args: argparse.Namespace, guard: PortGuard | None) -> int:
    from yahboomd.blackbox.box_keeper import BoxKeeper
    from yahboomd.cli.process_limits import make_room
    from yahboomd.core.daemon.logs import configure, flush
    from yahboomd.core.daemon.process import die_of
    from yahboomd.core.daemon.service import Daemon
    from yahboomd.ros2.ros2_plane import Ros2Plane
    from yahboomd.tools.people.people_plane import PeoplePlane, people_of

    loaded = read_config(args)
    configure(loaded.config.log.level, os.environ, sys.stderr)
    make_room()
    log = logging.getLogger("yahboomd")
    people = people_of(loaded.config)
    for warning in loaded.warnings:
        log.warning("%s", warning)

    async def main() -> int:
        daemon = Daemon(
            loaded.config,
            environ=os.environ,
            black_box=BoxKeeper,
            planes=(Ros2Plane(), *((PeoplePlane(people),) if people else ())),
            guard=guard,
        )
        status = os.EX_OK
        try:
            await daemon.run()
        except BaseExceptionGroup:
            # A fault of yahboomd, not of the user: the traceback goes to the log.
            log.critical("yahboomd failed; a stop was sent to the wheels", exc_info=True)
            status = os.EX_SOFTWARE
        if status == os.EX_OK and not daemon.left_standing:
            log.critical(
                "yahboomd ends with status %d: it did not see the wheels stand. Look at them; "
                "`yahboomd stop --direct` stops them.",
                os.EX_TEMPFAIL,
            )
            status = os.EX_TEMPFAIL
        if daemon.fatal_signal is not None:
            # The wheels are stopped: end by the signal, as it does by default.
            flush()
            die_of(daemon.fatal_signal)
            status = 128 + daemon.fatal_signal
        if not daemon.left_clean:
            log.warning("the bus does not close; the wheels are stopped, and the process ends here")
            flush()
            os._exit(status)
        return status

    try:
        return asyncio.run(main())
    except BusError as error:
        raise _explained(error, loaded.config) from error
    finally:
        flush()


def _start_guard() -> PortGuard:
    """Start the guard; if it does not start no wheel is turned."""
    from yahboomd.core.config import runtime_folder
    from yahboomd.core.link.port_guard import PortGuard

    folder = runtime_folder(os.environ, user_id=os.getuid())
    guard = PortGuard(partial(charge.start, kills=True, folder=str(folder)))
    try:
        guard.begin()
    except OSError as error:
        say(f"The guard does not start ({error.strerror}): no wheel is turned.")
    return guard


def _explained(error: BusError, config: Config) -> BusError:
    """The same error, with the wrong key, or what ends the process on the listen port."""
    if isinstance(error, BusConfigError):
        from yahboomd.core.daemon.assembly import bus_options
        from yahboomd.tools.robot.zenoh_file import with_key

        return with_key(error, bus_options(config))
    found = re.search(
        r"the process (?P<name>.+) \((?P<pid>\d+)\) listens there already", str(error)
    )
    if found is None:
        return error
    pid = int(found["pid"])
    name = "yahboomd" if is_yahboomd(pid) else found["name"]
    message = error.message.replace(f"the process {found['name']} ({pid})", f"{name} (pid {pid})")
    instead = "Or give this one another port: --set zenoh.listen=tcp/127.0.0.1:7449"
    if process_state(pid) in FROZEN:
        remedy = f"It is suspended. Continue it with `fg` or `kill -CONT {pid}`, or end it: kill -9"
        return BusError(message, remedy=f"{remedy} {pid}\n{instead}")
    return BusError(message, remedy=f"End it: kill {pid}\n{instead}")
