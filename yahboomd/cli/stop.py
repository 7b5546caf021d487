"""``yahboomd stop``: stops the wheels, whatever drives them, and watches until they stand.

It imports only what ``--help`` needs: with ``--port`` it sends the first stop before asyncio,
pydantic and Zenoh are loaded.
"""

from __future__ import annotations

import argparse
import contextlib
import os
from threading import Thread
from typing import TYPE_CHECKING

from yahboomd.cli.shared_options import (
    add_bus_options,
    add_config_options,
    add_port_option,
    daemon_endpoints,
    read_config,
)
from yahboomd.core.errors import ConfigError, LinkError, NoDaemon, PortBusy, YahboomdError
from yahboomd.core.link.seize import Seized
from yahboomd.core.program import STANDARD_PATH
from yahboomd.tools.stop.stop_advice import (
    StopOptions,
    no_answer,
    not_found,
    not_released,
    silent,
    unreached,
)
from yahboomd.tools.stop.stop_port import (
    port_of,
    print_report,
    seize_named,
    seize_noted,
    seize_noted_ports,
    seize_port,
    undisturbed,
    warn,
)

if TYPE_CHECKING:
    from yahboomd.core.config import Config
    from yahboomd.core.link.port_note import PortNote
    from yahboomd.core.link.takeover import TakeoverReport
    from yahboomd.tools.stop.stop_client import BusStop
    from yahboomd.tools.stop.stop_local import LocalStops, StopOutcome

NOT_STANDING = 1
"""The exit status if the wheels were not seen to stand."""

LATCHED_WITHIN_S = 2.0

SERIAL = "YAHBOOMD_SERIAL_"
NAMING = (SERIAL, "YAHBOOMD_ZENOH_")
"""Prefixes of variables that name a robot; other variables do not narrow a stop."""

DESCRIPTION = """\
Stop the wheels, and see that they stand. A running daemon engages its emergency stop, and keeps it
until it is released. The daemons of this machine are reached over their local sockets, others over
the bus: all of this machine, unless --port, --namespace, --config or --set names one. If no
daemon holds the port, the command opens it: it stops the board, watches its counters until the
wheels stand, and lets its motors go.

A stop that names nothing also ends every `setup` and `tune` of this machine, on whatever port and
whatever daemon there is: each has a local socket, too. --port ends the one that has that port.
"""

EPILOG = """\
examples:
  yahboomd stop                        whatever drives on this machine, and every setup and tune
  yahboomd stop --namespace bot1       one of several robots
  yahboomd stop --release              let a stopped daemon drive again
  yahboomd stop --connect tcp/192.168.1.5:7447
                                       a daemon on another machine
  yahboomd fleet stop                  every robot of a fleet (the package yahboomd-fleet)
  yahboomd stop --direct --port /dev/yahboom_driver
                                       after a daemon was killed: ExecStopPost= of a service

exit status:
  0    the wheels stand; with --release: the emergency stop is released
  1    they were stopped, and not seen to stand; with --release: it is refused
  69   no port, or no daemon
  77   no permission
  78   a mistake in the configuration
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
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
    """Stop, or release the emergency stop."""
    if args.release:
        return _release(args)
    if args.connect:
        return _status(_bus(args))
    with undisturbed():
        return _status(_direct(args) if args.direct else _everywhere(args))


def _release(args: argparse.Namespace) -> int:
    from yahboomd.tools.stop.stop_client import release
    from yahboomd.tools.stop.stop_local import DaemonChoice, find

    config = read_config(args).config
    endpoints = daemon_endpoints(args, config)
    found = [robot for robot in find(os.environ) if not robot.command]
    try:
        words = release(endpoints, config, port=args.port or "")
    except NoDaemon as error:
        raise not_released(error, _asked(args), found, endpoints) from error
    wanted = DaemonChoice(namespace=config.zenoh.namespace, listen=endpoints)
    answered = [robot for robot in found if not robot.silent and wanted.fits(robot)]
    print(f"{answered[0].name}: {words}" if len(answered) == 1 else words)
    return os.EX_OK


def _needs_no_configuration(args: argparse.Namespace) -> bool:
    """Whether the port is named, and no other option configures how to open it."""
    configured = (
        args.config or args.overrides or any(name.startswith(SERIAL) for name in os.environ)
    )
    return bool(args.port) and not configured


def _configuration(args: argparse.Namespace) -> Config:
    """The configuration, or the defaults: a broken file must not keep the wheels turning."""
    from yahboomd.core.config import Config

    return _readable_configuration(args) or Config()


def _readable_configuration(args: argparse.Namespace) -> Config | None:
    """The configuration; None after a warning if it is broken."""
    try:
        return read_config(args).config
    except ConfigError as error:
        warn(f"{error}\nStopping with the defaults instead.")
        return None


def _asked(args: argparse.Namespace) -> StopOptions:
    import shlex

    words = ["yahboomd", "stop", *(["--release"] if args.release else [])]
    for option in ("port", "namespace", "config"):
        value = getattr(args, option)
        words += [f"--{option}", str(value)] if value else []
    words += [word for each in args.connect or () for word in ("--connect", each)]
    words += [word for each in args.overrides for word in ("--set", each)]
    return StopOptions(
        port=args.port or "",
        namespace=args.namespace or "",
        connect=tuple(args.connect or ()),
        again=shlex.join(words),
    )


def _status(stood: bool) -> int:
    return os.EX_OK if stood else NOT_STANDING


def _direct(args: argparse.Namespace) -> bool:
    # Also with --config, as a service stops: the board may have another name since then.
    seized = [] if args.port or args.overrides else seize_noted_ports()
    named = [] if seized or _needs_no_configuration(args) else _seize_configured(args)
    if not seized and not named:
        config = None if _needs_no_configuration(args) else _configuration(args)
        seized = [seize_port(args.port, config)]
    stood = _print_reports(_on_ports(seized or named))
    if named:
        _warn_of_mistakes(args)
    return stood


def _seize_configured(args: argparse.Namespace) -> list[Seized]:
    """Seize the port that the configuration names, before the whole of it is checked."""
    from yahboomd.tools.stop.named_port import named_port

    path = args.config or (STANDARD_PATH if STANDARD_PATH.exists() else None)
    found = named_port(path, os.environ, args.overrides, args.port or "")
    return [] if found is None else [seize_named(found)]


def _warn_of_mistakes(args: argparse.Namespace) -> None:
    try:
        read_config(args)
    except ConfigError as error:
        warn(f"{error}\nThis stop used nothing but the port.")


def _bus(args: argparse.Namespace) -> bool:
    config = _configuration(args)
    endpoints = daemon_endpoints(args, config)
    _, answer, _ = _stop([], config, endpoints)
    if answer is None:
        from yahboomd.tools.stop.stop_client import no_daemon

        raise no_answer(no_daemon(endpoints), _asked(args), endpoints)
    print(answer.words)
    return answer.stood


def _everywhere(args: argparse.Namespace) -> bool:
    """Stop on the port if it is free, on the daemons' sockets of this machine, and on the bus."""
    seized: list[Seized] = []
    trouble: YahboomdError | None = None
    first = _needs_no_configuration(args)
    if first:
        # Before anything is imported or asked, because a free port is the fastest way.
        seized, trouble = _try_port(args, None)
    from yahboomd.tools.stop.stop_local import (
        LocalStops,
        covered,
        drives,
        notes,
        unproved,
        vouched_for,
    )

    local = LocalStops()
    config = _stop_locally(args, local)
    if not first:
        config = config or _configuration(args)
        seized, trouble = _try_port(args, config)
    config = config or _configuration(args)
    dead = notes(os.environ, local.wanted, local.answering)
    of_the_dead = _seize_noted(dead)
    # A disk that hangs holds up no stop.
    latching = Thread(target=_latch, args=(dead, seized + of_the_dead), daemon=True)
    latching.start()
    endpoints = daemon_endpoints(args, config)
    reports, answer, found = _stop(
        seized + of_the_dead, config, endpoints, local, port=args.port or ""
    )
    latching.join(LATCHED_WITHIN_S)
    if latching.is_alive():
        warn("The emergency stop is not on file yet: the disk does not answer.")
    outcomes = [each for each in found if each.robot.believed]
    boards = [each.path for each in seized + of_the_dead]
    boards += [path for each in outcomes if not each.blind for path in each.robot.ports]
    several = len(found) > 1
    verdicts = [_print_outcome(each, several) for each in outcomes if not covered(each, boards)]
    for each in outcomes:
        if covered(each, boards):
            print(f"{each.robot.name} does not hold the port; its emergency stop is engaged too.")
    if answer is not None and answer.daemons > len(outcomes):
        print(answer.words)
        verdicts.append(answer.stood)
    verdicts += [print_report(report) for report in reports]
    for each in found:
        if each not in outcomes:
            warn(unproved(each))
    doubted = [each for each in found if each not in outcomes and not vouched_for(each, boards)]
    if (
        verdicts
        and all(each.robot.uid not in {0, os.geteuid()} for each in outcomes)
        and isinstance(trouble, PortBusy)
        and (answer is None or answer.daemons <= len(outcomes))
        and not drives(local.answering, port_of(args.port, config))
    ):
        # The configured port is held, and no answer proves that its board was stopped: robots of
        # other users may stand, which proves nothing about this one.
        verdicts.append(_report_busy(args, config, endpoints))
    if verdicts:
        troubles = [str(silent(robot, _asked(args))) for robot in local.silent]
        if local.wanted == type(local.wanted)():
            troubles += unreached(local, endpoints if answer is not None else ())
        for words in troubles:
            warn(words)
        return all(verdicts) and not troubles and not doubted
    if local.silent:
        raise silent(local.silent[0], _asked(args))
    if not isinstance(trouble, PortBusy):
        if doubted:
            return False
        assert trouble is not None
        raise not_found(trouble, config, endpoints, local)
    # No daemon answers: the process that held the port may have been about to end.
    stand = _print_reports(_on_ports([seize_port(args.port, config, asked=endpoints)]))
    return stand and not doubted


def _try_port(
    args: argparse.Namespace, config: Config | None
) -> tuple[list[Seized], YahboomdError | None]:
    """Seize the port if it is free; otherwise return the reason why not."""
    try:
        return [seize_port(args.port, config, patience_s=0.0)], None
    except (LinkError, ConfigError) as error:
        return [], error


def _seize_noted(dead: list[PortNote]) -> list[Seized]:
    """Seize the ports of killed daemons, because nothing else stops their boards."""
    seized = []
    for note in (each for each in dead if not each.ended):
        # Suppressed errors: this process or another one holds the port, or the device is gone or
        # is another one by now, and cannot be stopped any more.
        with contextlib.suppress(LinkError):
            found = seize_noted(note)
            seized += [found] if found is not None else []
    return seized


def _latch(dead: list[PortNote], seized: list[Seized]) -> None:
    """Engage the emergency stop of killed daemons on file: the next ones stand until a release."""
    from pathlib import Path

    from yahboomd.core.daemon.estop.latch_file import LatchFile
    from yahboomd.tools.stop.stop_local import same_port

    for note in dead:
        if note.latch and any(same_port(note.path, each.path) for each in seized):
            try:
                LatchFile(Path(note.latch)).engage("yahboomd stop")
                print(f"{note.path}: emergency stop engaged, until `yahboomd stop --release`.")
            except OSError as error:
                warn(f"{note.latch}: the emergency stop is not on file ({error.strerror}).")


def _report_busy(args: argparse.Namespace, config: Config, endpoints: tuple[str, ...]) -> bool:
    try:
        return _print_reports(_on_ports([seize_port(args.port, config, asked=endpoints)]))
    except LinkError as error:
        warn(str(error))
        return False


def _stop_locally(args: argparse.Namespace, local: LocalStops) -> Config | None:
    """Engage the emergency stop of the wanted daemons of this machine.

    Returns:
        The configuration, if it had to be read.
    """
    from yahboomd.tools.stop.stop_local import DaemonChoice, find

    named = args.config or args.overrides or any(name.startswith(NAMING) for name in os.environ)
    wanted = DaemonChoice(port=args.port or "", namespace=args.namespace)
    config = None
    if named and not args.port:
        config = _readable_configuration(args)
        if config is not None:
            zenoh = config.zenoh
            wanted = DaemonChoice(config.serial.port, zenoh.namespace, zenoh.listen)
        else:
            from yahboomd.core.config import Config

            config = Config()
    local.engage(wanted, find(os.environ))
    return config


def _print_outcome(outcome: StopOutcome, several: bool) -> bool:
    words = f"{outcome.robot.name}: {outcome.words}" if several else outcome.words
    if outcome.stood:
        print(words)
    else:
        warn(words)
    return outcome.stood


def _print_reports(reports: list[TakeoverReport]) -> bool:
    verdicts = [print_report(report) for report in reports]
    return all(verdicts)


def _on_ports(seized: list[Seized]) -> list[TakeoverReport]:
    return _stop(seized, None)[0]


def _stop(
    seized: list[Seized],
    config: Config | None,
    endpoints: tuple[str, ...] = (),
    local: LocalStops | None = None,
    *,
    port: str = "",
) -> tuple[list[TakeoverReport], BusStop | None, list[StopOutcome]]:
    """Stop on the seized ports, and if a configuration is given on the bus.

    Meanwhile watch the daemons that were stopped over their sockets.
    """
    import asyncio

    async def on_ports() -> list[TakeoverReport]:
        if not seized:
            return []
        from yahboomd.core.clock import SystemClock
        from yahboomd.core.link.takeover import take_over_seized

        clock = SystemClock()
        return await asyncio.gather(*(take_over_seized(each, clock) for each in seized))

    async def on_bus() -> BusStop | None:
        if config is None:
            return None
        from yahboomd.tools.stop.stop_client import engage

        return await engage(endpoints, config, port=port)

    async def here() -> list[StopOutcome]:
        return [] if local is None else await asyncio.to_thread(local.outcomes)

    async def all_of_it() -> tuple[list[TakeoverReport], BusStop | None, list[StopOutcome]]:
        return await asyncio.gather(on_ports(), on_bus(), here())

    return asyncio.run(all_of_it())
