"""The port half of ``yahboomd stop``: taking the port, and saying how the stop went.

What takes long to import is imported where it is used: see :mod:`yahboomd.link.seize`.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING

from yahboomd.cli.options import read_config
from yahboomd.errors import ConfigError, LinkError, PortBusy
from yahboomd.link import port_note
from yahboomd.link.seize import PATIENCE_S, Seized, seize

if TYPE_CHECKING:
    from yahboomd.config import Config
    from yahboomd.link.takeover import TakeoverReport

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextlib.contextmanager
def undisturbed() -> Iterator[None]:
    """Go on to the end whoever is impatient: it takes some seconds at most."""
    before = {number: signal.signal(number, signal.SIG_IGN) for number in _SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def needs_no_configuration(args: argparse.Namespace) -> bool:
    """Whether the port was named, and nobody asked for another way to open it."""
    told = args.config or args.overrides or any(name.startswith(_SERIAL) for name in os.environ)
    return bool(args.port) and not told


def configuration(args: argparse.Namespace) -> Config:
    """The configuration; a broken one must not keep the wheels turning."""
    try:
        return read_config(args).config
    except ConfigError as error:
        from yahboomd.config import Config

        warn(f"{error}\nStopping with the defaults instead.")
        return Config()


def take_noted(args: argparse.Namespace) -> Seized | None:
    """Take the port as the daemon that was killed had it, if it left a note of that.

    That is so for ``ExecStopPost=`` of the service. Where the note does not lead to a port, the
    configuration has to.
    """
    note = None if args.port or args.overrides else port_note.read(os.environ)
    if note is None:
        return None
    try:
        return seize(**note._asdict())
    except OSError:
        return None


def take(
    args: argparse.Namespace,
    config: Config | None,
    *,
    patience_s: float = PATIENCE_S,
    asked: tuple[str, ...] = (),
) -> Seized:
    """Take the port and say the first stop.

    Args:
        args: Names the port, perhaps.
        config: How it is opened; None for the defaults, with the port that ``args`` names.
        patience_s: How long to try again while somebody else holds it.
        asked: Where a daemon was asked on the bus, and did not answer.

    Raises:
        LinkError: It cannot be had.
        ConfigError: Several ports could be the board's.
    """
    path: str = args.port or (config.serial.port if config is not None else "")
    if not path:
        from yahboomd.link.discovery import candidates, choose

        path = choose("", candidates())
    try:
        if config is None:
            return seize(path, patience_s=patience_s)
        return seize(
            path,
            baudrate=config.serial.baudrate,
            dtr=config.serial.dtr,
            rts=config.serial.rts,
            hangup_on_close=config.serial.hangup_on_close,
            patience_s=patience_s,
        )
    except OSError as error:
        raise _explained(path, error, asked) from error


def _explained(path: str, error: OSError, asked: tuple[str, ...]) -> LinkError:
    from yahboomd.link.diagnosis import busy
    from yahboomd.link.port_errors import explained, holders

    why = explained(path, error)
    if not isinstance(why, PortBusy):
        return why
    who = holders(path)
    if not any(each.startswith("yahboomd ") for each in who):
        hints = " ".join(busy(who))
        return PortBusy(
            why.message, remedy=f"End it ({end(who)}), then stop again. {hints}".rstrip()
        )
    if asked:
        return PortBusy(
            f"{why.message} It does not answer at {' or '.join(asked)}.",
            remedy=f"Only it can stop the wheels, and does so as it ends: {end(who)}",
        )
    return PortBusy(
        why.message,
        remedy="Only it can stop the wheels: `yahboomd stop`, without --direct, asks it over the "
        f"bus; ending it ({end(who)}) stops them too.",
    )


def end(who: tuple[str, ...]) -> str:
    """The command that ends the holders of a port, named as ``name (pid N)``."""
    pids = " ".join(each.rpartition("pid ")[2].rstrip(")") for each in who)
    return f"kill {pids}" if pids else "kill PID"


def tell(report: TakeoverReport) -> bool:
    """Say how a stop on the port went; whether the wheels were seen to stand."""
    words = describe(report)
    if report.stood:
        print(words)
    else:
        warn(words)
    return report.stood is True


def describe(report: TakeoverReport) -> str:
    """How a stop on the port went, in words."""
    if report.dialect is None:
        from yahboomd.link.diagnosis import what_was_heard

        return (
            f"{report.port}: both dialects' stop was said, but no board answers, so nobody can "
            f"tell whether the wheels stand. {what_was_heard(report.heard)}"
        )
    where = f"{report.port} ({report.dialect} board)"
    if report.stood is None:
        return f"{where}: stopped, but no counters came: look at the wheels."
    after = f"{report.within_s:.2f} s after the first stop frame"
    if not report.stood:
        return (
            f"{where}: the wheels still turn, {after}, and nothing more can be commanded. Unless a "
            "hand or a slope turns them, switch off the supply of the motors."
        )
    released = "; they did not obey the brake and were let go" if report.cut else ""
    return f"{where}: the wheels stand, {after}{released}."


def warn(words: str) -> None:
    """Say it where errors are said."""
    print(f"yahboomd: {words}", file=sys.stderr)


_SERIAL = "YAHBOOMD_SERIAL_"
