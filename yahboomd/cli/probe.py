"""``yahboomd probe``: finds the port, names the board, explains problems, stores settings."""

from __future__ import annotations

import argparse
import asyncio
import os
import shutil
import sys
from collections.abc import Iterable, Sequence

import msgspec

from yahboomd import __version__
from yahboomd.cli.shared_options import (
    add_bus_options,
    add_config_options,
    add_port_option,
    daemon_endpoints,
    read_config,
)
from yahboomd.core.clock import SystemClock
from yahboomd.core.config import Config
from yahboomd.core.errors import (
    BoardSilent,
    ConfigError,
    LinkError,
    PortBusy,
    PortMissing,
    YahboomdError,
)
from yahboomd.core.link import discovery, latency_timer, storing
from yahboomd.core.link.port_errors import holders
from yahboomd.core.program import readable
from yahboomd.core.protocol.registry import DIALECTS, check_storable
from yahboomd.core.protocol.settings import BoardSettings, StoredSetting
from yahboomd.tools.port import probing
from yahboomd.tools.port.own_port import opener_of, with_hints
from yahboomd.tools.probe import probe_report, probe_text
from yahboomd.tools.probe.probe_report import Report, StoredValue
from yahboomd.tools.probe.probe_write import Printed, agreed, stored_value
from yahboomd.tools.stop import diagnosis, stop_local
from yahboomd.tools.stop.port_search import find_port, on_board
from yahboomd.tools.stop.unresponsive import true_names

FOUND_WANTING = 1
"""The exit status if the board must not be driven as it is, or did not store everything."""

DESCRIPTION = """\
Find the board's port, stop its wheels, read everything that it reports, and explain problems.
Nothing moves, and nothing is written to the board unless --write is given.
"""

EPILOG = """\
examples:
  yahboomd probe                          the only board on USB, or the one that a daemon has
  yahboomd probe --list                   the serial ports of this machine
  yahboomd probe --write                  store the configured profile's settings on the board
  yahboomd probe --write --set board.profile=310

exit status:
  0    the board may be driven
  1    it must not be, as it is
  69   no port, a held one, or no board
  77   no permission
  78   a mistake in the configuration, or several boards to choose from
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("--list", action="store_true", help="list the serial ports, open none")
    parser.add_argument("--json", action="store_true", help="one JSON object, for programs")
    parser.add_argument(
        "--write",
        action="store_true",
        help="store the profile's settings in the board's flash: only what differs, one value at "
        "a time, each read back, the wheels at rest",
    )
    for row in _own_options():
        parser.add_argument(
            f"--{row.field}",
            metavar=",".join(row.parts).upper(),
            type=_numbers,
            help=row.option,
        )
    parser.add_argument(
        "--yes", action="store_true", help="with --write: do not ask before storing"
    )
    add_port_option(parser)
    add_config_options(parser)
    add_bus_options(parser)


def _own_options() -> Iterable[StoredSetting]:
    """The stored values that do not belong to a profile, each once."""
    rows = [row for dialect in DIALECTS.values() for row in dialect.settings if row.option]
    return {row.field: row for row in reversed(rows)}.values()


def _numbers(text: str) -> tuple[float, float, float]:
    try:
        p, i, d = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"three numbers, as 0.8,0.06,0.5, not {text!r}") from None
    return p, i, d


def run(args: argparse.Namespace) -> int:
    """Probe."""
    if args.list:
        return _list(as_json=args.json)
    try:
        return _probe(args)
    except YahboomdError as error:
        if not args.json:
            raise
        print(_json(Report(error=str(error), ports=discovery.candidates())))
        return error.exit_code


def _list(*, as_json: bool) -> int:
    found = (*discovery.candidates(), *on_board())
    if as_json:
        print(_json(Report(ports=found)))
    else:
        name = discovery.UDEV_NAME
        target = os.path.realpath(name) if os.path.exists(name) else ""
        print("\n".join(probe_text.listing(found, name, target)))
        if hint := discovery.without_driver():
            print(hint)
    return os.EX_OK if found else os.EX_UNAVAILABLE


def _probe(args: argparse.Namespace) -> int:
    config = read_config(args).config
    want = config.profile().settings
    given = {row.field: getattr(args, row.field) for row in _own_options()}
    want = want | {field: value for field, value in given.items() if value is not None}
    check_storable(want)
    port = ""
    try:
        port = find_port(config)
        report = _examine(port, config, want, reopening=not args.write)
    except (PortBusy, PortMissing, ConfigError) as error:
        # If a named port does not exist, no daemon has it.
        ask = not args.write and (not port or isinstance(error, PortBusy))
        reported = _ask_daemon(args, config, port, want) if ask else None
        if reported is None:
            if port:
                raise with_hints(error, port) from error
            raise (error if args.write else _with_daemons(error)) from error
        report = reported
    except LinkError as error:
        raise with_hints(error, port) from error
    if not args.json:
        _print(probe_text.text(report))
    if args.write:
        return _write(args, port, config, want, report)
    if args.json:
        print(_json(report))
    else:
        _print(["", *probe_text.verdict(report, _width())])
    return FOUND_WANTING if report.problems else os.EX_OK


def _examine(port: str, config: Config, want: BoardSettings, *, reopening: bool) -> Report:
    clock = SystemClock()
    opener = opener_of(port, config, clock)

    async def both() -> tuple[probing.Examination, probing.Reopening | None]:
        found = await probing.examine(opener, clock, want)
        if found.dialect is None or not reopening:
            return found, None
        return found, await probing.reopen(opener, clock, found)

    found, reopened = asyncio.run(both())
    if found.dialect is None:
        serial = config.serial
        lines = ", ".join(
            f"{name} {'on' if on else 'off'}"
            for name, on in (("DTR", serial.dtr), ("RTS", serial.rts))
        )
        raise BoardSilent(
            f"{port}: no board answers (opened at {serial.baudrate} baud, {lines}).",
            remedy=diagnosis.what_was_heard(found.heard, found.readers),
        )
    return _report(port, config, found, reopened, want)


def _report(
    port: str,
    config: Config,
    found: probing.Examination,
    reopened: probing.Reopening | None,
    want: BoardSettings,
) -> Report:
    report = probe_report.report(
        found,
        reopened,
        port=port,
        device=os.path.realpath(port),
        profile=config.profile(),
        want=want,
        wanted_dialect=config.serial.dialect,
    )
    late = latency_timer.describe(port)
    if late is None:
        return report
    return msgspec.structs.replace(report, advice=(*report.advice, late))


def _with_daemons(error: YahboomdError) -> YahboomdError:
    """The same error, with the daemons of this machine: one of them may have the board."""
    found = [
        robot for robot in stop_local.find(os.environ) if not robot.silent and not robot.command
    ]
    return type(error)(error.message, remedy=stop_local.there(found, "probe") or error.remedy)


def _ask_daemon(
    args: argparse.Namespace, config: Config, port: str, want: BoardSettings
) -> Report | None:
    """A report of the board from the daemon that has it; None if no daemon answers.

    Args:
        port: The port that the daemon holds; empty for any.
    """
    from yahboomd.tools.probe.probe_client import ask_board

    endpoints = daemon_endpoints(args, config)
    reported = asyncio.run(ask_board(endpoints, config))
    if reported is None or (port and reported.found is None):
        # The caller then reports that another program holds the port.
        return None
    if reported.found is None:
        where = " or ".join(endpoints)
        raise PortMissing(
            f"The daemon at {where} has no board.",
            remedy="Plug the board in, power it, and look at the port that the daemon is set to: "
            "`yahboomd monitor` shows why it waits, `yahboomd probe --list` the ports.",
        )
    port = port or reported.port
    who = true_names(", ".join(holders(port))) or "another process"
    held = (
        f"The port is held by {who}, and this is the daemon's own report of its board. With the "
        "daemon ended, probe also reports whether the counters survive a reopening."
    )
    return msgspec.structs.replace(
        _report(port, config, reported.found, None, want), advice=(held,)
    )


def _write(
    args: argparse.Namespace, port: str, config: Config, want: BoardSettings, report: Report
) -> int:
    stored: tuple[StoredValue, ...] = ()
    after = report
    if report.differing:
        if report.problems and not args.json:
            _print(["", *probe_text.verdict(report, _width())])
        if not (args.yes or agreed(len(report.differing))):
            _say(args, "Nothing was stored.")
            return FOUND_WANTING if report.problems else os.EX_OK
        clock = SystemClock()
        opener = opener_of(port, config, clock)
        _say(args, "")
        outcome = asyncio.run(storing.store(opener, clock, want, None if args.json else Printed()))
        stored = tuple(stored_value(step) for step in outcome.steps)
        after = _examine(port, config, want, reopening=False)
    complete = all(value.outcome == "stored" for value in stored) and not after.differing
    if args.json:
        print(_json(msgspec.structs.replace(after, stored=stored)))
    else:
        if not report.settings:
            done = "Nothing was stored: the board shows no settings."
        elif complete:
            done = f"The board stores the profile {after.profile}."
        else:
            done = "The board does not store all of it."
        _print(["", done, *probe_text.verdict(after, _width())])
    return os.EX_OK if complete and not after.problems else FOUND_WANTING


def _say(args: argparse.Namespace, words: str) -> None:
    if not args.json:
        print(words)


def _json(report: Report) -> str:
    report = msgspec.structs.replace(report, yahboomd=__version__)
    return readable(msgspec.json.format(msgspec.json.encode(report), indent=2).decode())


def _width() -> int:
    return min(100, shutil.get_terminal_size((100, 24)).columns)


def _print(lines: Sequence[str]) -> None:
    lines = [readable(line) for line in lines]
    colours = sys.stdout.isatty() and not os.environ.get("NO_COLOR")
    print("\n".join(probe_text.painted(lines) if colours else lines))
