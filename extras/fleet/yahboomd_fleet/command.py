"""``yahboomd fleet``: certificates and access rules for many robots, what each does, and a stop."""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING

from yahboomd.cli.shared_options import add_connect_option, number, seconds

if TYPE_CHECKING:
    from yahboomd_fleet.fleet_files import FleetFolder
    from yahboomd_fleet.fleet_plan import FleetPlan

DESCRIPTION = """\
Make the certificates and the access rules of a fleet from one file, which lists its sites, its
robots and its people with their roles. Each router, robot and person gets one file of Zenoh's with
everything in it. Nothing is sent: you copy the files. The key that signs certificates stays in the
folder beside the file, on this machine.

`status` asks the robots what they do, and prints those that need somebody first. `stop` asks each
until all acknowledged that the stop was sent to their boards, and prints who stands, who did not
answer and who is not reachable.
"""

EPILOG = """\
examples:
  yahboomd fleet init fleet.toml             the authority and all files, in the folder fleet/
  yahboomd fleet add fleet.toml              the files of robots and people that were added to it
  yahboomd fleet check fleet.toml anna       what may this certificate do, and until when?
  yahboomd fleet renew fleet.toml            new certificates for those that end within 30 days
  yahboomd fleet revoke fleet.toml anna      take every right away, and list the files to copy
  yahboomd fleet stop                        every robot of your own file: stop, and see who stands
  yahboomd fleet status --watch              every robot of your own file, as it changes
  yahboomd fleet status --json | jq '.[] | select(.needs != "")'
                                             the robots that need somebody, for a script

exit status:
  0    it was done; of `status`: every robot can drive; of `stop`: every robot stands
  1    of `status`: some robot cannot drive, or is not reachable; of `stop`: some robot does not
       stand, or is missing
  69   of `status`: no robot answered
  78   a mistake in the file, or the folder cannot be used: the message has the reason
"""

NOT_STANDING = 1
"""The exit status if some robot was not seen to stand."""

COPY = "Copy each to its machine, readable by its user alone; restart routers and robots:"

VERBS = {
    "init": "make the authority and all files",
    "add": "make the files that are missing, and write changed rules",
    "renew": "make new certificates",
    "revoke": "take every right of a certificate away",
    "check": "print what a certificate may do",
}


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the verbs."""
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)
    for name, words in VERBS.items():
        verb = verbs.add_parser(name, help=words, description=f"{words.capitalize()}.")
        verb.add_argument(
            "file",
            metavar="FILE",
            type=Path,
            help="the fleet's file, fleet.toml; the others are in the folder of its name, fleet/",
        )
        if name == "renew":
            verb.add_argument(
                "names",
                metavar="NAME",
                nargs="*",
                # Without one, whether it is optional depends on the version of argparse.
                default=[],
                help="robots, sites or people (default: by age)",
            )
            verb.add_argument(
                "--within",
                metavar="DAYS",
                type=number("a number of days from 0 to 90", lambda days: 0.0 <= days <= 90.0),
                default=30.0,
                help="without names: certificates that end within this time (default: %(default)g)",
            )
        elif name in {"revoke", "check"}:
            verb.add_argument("name", metavar="NAME", help="a robot, a site or a person")
    words = "print what each robot does, those that need somebody first"
    status = verbs.add_parser("status", help=words, description=f"{words.capitalize()}.")
    how = status.add_mutually_exclusive_group()
    _add_papers_option(how)
    add_connect_option(
        how,
        "a router or daemon without access rules, such as tcp/192.168.1.5:7447: every robot that "
        "is seen there",
    )
    status.add_argument(
        "--watch", action="store_true", help="go on until Ctrl-C: a screen, or lines for a file"
    )
    status.add_argument(
        "--json",
        action="store_true",
        help="a JSON array of all robots; with --watch a line of JSON for each change",
    )
    status.add_argument(
        "--timeout",
        metavar="S",
        type=seconds,
        default=3.0,
        help="how long to wait for answers, in seconds (default: %(default)g)",
    )
    words = "stop every robot, over all routers, until each acknowledged; Ctrl-C ends it"
    _add_papers_option(verbs.add_parser("stop", help=words, description=f"{words.capitalize()}."))


def _add_papers_option(parser: argparse._ActionsContainer) -> None:  # parsers and their groups
    parser.add_argument(
        "--fleet",
        metavar="FILE",
        type=Path,
        help="your file of `yahboomd fleet` (default: ~/.config/yahboomd/fleet.json5)",
    )


def run(args: argparse.Namespace) -> int:
    """Carry out one verb."""
    if args.verb == "status":
        return _status(args)
    if args.verb == "stop":
        return _stop(args.fleet)
    from yahboomd_fleet.fleet_check import full_name
    from yahboomd_fleet.fleet_files import FleetFolder
    from yahboomd_fleet.fleet_plan import read_plan

    plan = read_plan(args.file)
    folder = FleetFolder(args.file.with_suffix(""), plan, datetime.now(UTC))
    match args.verb:
        case "init":
            folder.begin()
            _write(folder)
        case "add":
            _write(folder)
            _print_revoked(folder, folder.paths())
        case "renew":
            days = timedelta(days=args.within)
            names = [full_name(plan, each) for each in args.names] or folder.ending(days)
            _write(folder, names)
            _print_revoked(folder, names)
        case "revoke":
            _revoke(folder, full_name(plan, args.name))
        case _:
            _check(folder, plan, full_name(plan, args.name))
    return os.EX_OK


def _status(args: argparse.Namespace) -> int:
    import asyncio

    from yahboomd.cli.attended import until_signal
    from yahboomd_fleet.fleet_list import FleetList, read_list, standard_papers
    from yahboomd_fleet.fleet_watch import watch

    papers = None if args.connect else args.fleet or standard_papers()
    if papers is None:
        # Without rules everybody may do everything.
        ways = {endpoint: [""] for endpoint in args.connect}
        fleet = FleetList(person="", role="maintainer", ways=ways, robots=[])
    else:
        fleet = read_list(papers)
    work = watch(fleet, papers, within_s=args.timeout, endless=args.watch, as_json=args.json)
    return asyncio.run(until_signal(work, (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)))


def _stop(named: Path | None) -> int:
    import asyncio

    from yahboomd.core.clock import SystemClock
    from yahboomd.tools.stop.stop_port import warn
    from yahboomd_fleet.fleet_list import read_list, standard_papers
    from yahboomd_fleet.fleet_stop import FleetStop
    from yahboomd_fleet.stop_all import StopAll

    papers = named or standard_papers()
    fleet = read_list(papers)
    progress = FleetStop(fleet.robots)

    # A reader that has left must not keep the robots driving.
    def tell(words: str) -> None:
        with contextlib.suppress(OSError):
            warn(words)

    with contextlib.suppress(OSError):
        print(f"Stopping {len(fleet.robots)} robots. Ctrl-C ends it.", flush=True)
    try:
        asyncio.run(StopAll(fleet, papers, progress, tell, SystemClock()).run())
    except KeyboardInterrupt:
        warn("Ended: from now on nothing repeats the stop for the robots that are missing.")
    print("\n".join(progress.report()))
    return os.EX_OK if progress.all_stand else NOT_STANDING


def _write(folder: FleetFolder, renewed: Iterable[str] = ()) -> None:
    """Write the files, and print each before it is written: an interrupt leaves a true list."""
    told: list[Path] = []

    def tell(path: Path) -> None:
        if not told:
            print(COPY)
        told.append(path)
        print(f"  {path}", flush=True)

    if not folder.write(renewed, tell):
        print("Nothing has changed.")


def _print_revoked(folder: FleetFolder, names: Iterable[str]) -> None:
    for name in sorted({each.name for each in folder.revoked()} & set(names)):
        print(f"{name} is revoked and gets nothing: a new certificate needs a new name.")


def _revoke(folder: FleetFolder, name: str) -> None:
    before = {each.name for each in folder.revoked()}
    revoked = folder.revoke(name)
    print(
        f"{name} has no rights in the files of this folder any more. A router or robot with an "
        f"older file accepts the certificate until it ends, {revoked.until:%Y-%m-%d %H:%M} UTC."
    )
    _write(folder)
    if name in before:
        print("It was revoked before. Each of these has to be on its machine, as it is now:")
        for path in folder.readers():
            print(f"  {path}")


def _check(folder: FleetFolder, plan: FleetPlan, name: str) -> None:
    from yahboomd_fleet.fleet_check import check

    for each in folder.revoked():
        if each.name == name:
            print(
                f"{name} is revoked. A router or robot with an older file accepts the certificate "
                f"until it ends, {each.until:%Y-%m-%d %H:%M} UTC."
            )
            return
    found = check(folder, plan, folder.paths()[name])
    ended = "" if found.until > datetime.now(UTC) else ": it has ended; `fleet renew` makes one"
    print(f"{found.name}, until {found.until:%Y-%m-%d %H:%M} UTC{ended}")
    for robot, by_way in found.by_way.items():
        for way, rights in by_way.items():
            print(f"  {robot} {way}: {', '.join(rights) or 'nothing'}")
