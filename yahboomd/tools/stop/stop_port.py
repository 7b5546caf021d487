"""The port half of ``yahboomd stop``: seizes the port, and reports the outcome.

Slow modules are imported at their first use: see :mod:`yahboomd.core.link.seize`.
"""

from __future__ import annotations

import contextlib
import errno
import os
import signal
import sys
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from yahboomd.core.errors import LinkError, PortBusy
from yahboomd.core.link import port_identity, port_note
from yahboomd.core.link.port_note import PortNote
from yahboomd.core.link.seize import PATIENCE_S, RETRY_S, OtherDevice, Seized, seize
from yahboomd.core.program import pasteable, readable
from yahboomd.tools.stop.unresponsive import (
    FROZEN,
    process_state,
    true_names,
    unresponsive,
)

if TYPE_CHECKING:
    from yahboomd.core.config import Config
    from yahboomd.core.link.takeover import TakeoverReport
    from yahboomd.tools.stop.named_port import NamedPort

_SIGNALS = (
    *(signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP),
    *(signal.SIGTTIN, signal.SIGTTOU, signal.SIGUSR1, signal.SIGUSR2, signal.SIGALRM),
)


@contextlib.contextmanager
def undisturbed() -> Iterator[None]:
    """Ignore signals until the stop is done, some seconds at most."""
    before = {number: signal.signal(number, signal.SIG_IGN) for number in _SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def seize_noted_ports() -> list[Seized]:
    """Seize the port of each killed daemon, by its note in the runtime folder.

    ``ExecStopPost=`` of the service needs it. If no note leads to a port, the caller uses the
    configuration. If a note leads to another device, that device is left alone, because udev may
    have given it the name.

    Raises:
        LinkError: A path leads to another device by now, and the board is not there.
    """
    notes = port_note.read(port_note.folder_of(os.environ))
    # A note of a daemon that ended in order counts only if there is no other.
    waiting = [note for note in notes if not note.ended] or notes
    several = len(waiting) > 1
    seized: list[Seized] = []
    trouble: LinkError | None = None
    deadline = time.monotonic() + PATIENCE_S
    while True:
        held = []
        for note in waiting:
            try:
                found = seize_noted(note)
            except PortBusy:
                # A running neighbour holds it, or for a moment the killed daemon.
                held.append(note)
            except LinkError as error:
                trouble = error
            else:
                seized += [found] if found is not None else []
        if not held or time.monotonic() >= deadline:
            break
        waiting = held
        time.sleep(RETRY_S)
    if not seized and trouble is not None:
        raise trouble
    for note in held if several and seized else ():
        if not _runs(note.pid):
            warn(f"{note.path} is held by another process, so no stop was sent there.")
    return seized


def _runs(pid: int) -> bool:
    """Whether a process runs. On a busy machine it may wait for the kernel (D) for a moment."""
    deadline = time.monotonic() + PATIENCE_S
    while (state := process_state(pid)) == "D" and time.monotonic() < deadline:
        time.sleep(RETRY_S)
    return state in {"R", "S"}


def seize_noted(note: PortNote) -> Seized | None:
    """Seize the port that a note leads to; ``None`` if it leads to none.

    Raises:
        PortBusy: Another process holds it.
        LinkError: The path leads to another device by now, and the board is not there.
    """
    try:
        return seize(**note.options(), patience_s=0.0)
    except OSError as error:
        if isinstance(error, BlockingIOError) or error.errno == errno.EBUSY:
            raise PortBusy(f"{note.path} is held by another process.") from error
        other = isinstance(error, OtherDevice)
    found = port_identity.find(note.device)
    if found is not None:
        try:
            seized = seize(**note._replace(path=found).options())
        except OSError as error:
            raise _explained(found, error, ()) from error
        warn(f"{note.path} no longer leads to the board, which is {found} now: stopped there.")
        return seized
    if not other:
        return None
    was = note.device.usb or f"number {os.major(note.device.number)}:{os.minor(note.device.number)}"
    raise LinkError(
        f"{note.path} is another device than the one that the daemon drove ({was}), which is not "
        "there any more. Nothing was sent to the other one.",
        remedy="If the wheels turn, switch the motors' supply off, or plug the board in again and "
        "run `yahboomd stop --port PATH`; `yahboomd probe --list` names the ports.",
    )


def port_of(port: str | None, config: Config | None) -> str:
    """The named port, else the configured one, else the only one there is.

    Raises:
        LinkError: There is none.
        ConfigError: Boards answer on several.
    """
    path = port or (config.serial.port if config is not None else "")
    if path:
        return path
    from yahboomd.core.config import Config
    from yahboomd.tools.stop.port_search import find_port

    return find_port(config or Config())


def seize_port(
    port: str | None,
    config: Config | None,
    *,
    patience_s: float = PATIENCE_S,
    asked: tuple[str, ...] = (),
) -> Seized:
    """Seize the port, which sends the first stop.

    Args:
        port: Its path; None for the configured one.
        config: The settings to open it with; None for the defaults.
        patience_s: How long to try again while another process holds it.
        asked: The endpoints at which no daemon answered.

    Raises:
        LinkError: It cannot be opened.
        ConfigError: No port is named, and boards answer on several.
    """
    path = port_of(port, config)
    options: dict[str, Any] = {}
    if config is not None:
        options = {
            "baudrate": config.serial.baudrate,
            "dtr": config.serial.dtr,
            "rts": config.serial.rts,
            "hangup_on_close": config.serial.hangup_on_close,
        }
    return _seize(path, options, patience_s, asked)


def seize_named(named: NamedPort) -> Seized:
    """The same, for a port whose configuration was not checked yet.

    Raises:
        LinkError: It cannot be opened.
    """
    options = named._asdict()
    return _seize(options.pop("port"), options, PATIENCE_S, ())


def _seize(path: str, options: dict[str, Any], patience_s: float, asked: tuple[str, ...]) -> Seized:
    try:
        return seize(path, **options, patience_s=patience_s)
    except OSError as error:
        raise _explained(path, error, asked) from error


def _explained(path: str, error: OSError, asked: tuple[str, ...]) -> LinkError:
    from yahboomd.core.link.port_errors import explained, holders
    from yahboomd.tools.stop.diagnosis import busy

    why = explained(path, error)
    if not isinstance(why, PortBusy):
        return why
    who = tuple(map(true_names, holders(path)))
    why = PortBusy(true_names(why.message), remedy=why.remedy)
    for name, pid in zip(who, pids(who), strict=True):
        if (state := process_state(pid)) in FROZEN:
            message, remedy = unresponsive(name, pid, state, f"yahboomd stop --port {path}")
            return PortBusy(f"{why.message} {message}", remedy=remedy)
    if not any(each.startswith("yahboomd ") for each in who):
        hints = " ".join(busy(who))
        return PortBusy(
            why.message, remedy=f"End it ({end(who)}), then stop again. {hints}".rstrip()
        )
    if asked:
        return PortBusy(
            f"{why.message} It does not answer at {' or '.join(asked)}.",
            remedy=f"Only it can stop the wheels, and does so as it ends: {end(who)}\n"
            f"If it does not end within 5 s: kill -9 {end(who).removeprefix('kill ')}; "
            f"yahboomd stop --port {path}",
        )
    return PortBusy(
        why.message,
        remedy="Only it can stop the wheels: `yahboomd stop`, without --direct, asks it over the "
        f"bus; ending it ({end(who)}) stops them too.",
    )


def end(who: tuple[str, ...]) -> str:
    """The command that ends the holders of a port, named as ``name (pid N)``."""
    return f"kill {' '.join(map(str, pids(who)))}" if who else "kill PID"


def pids(who: tuple[str, ...]) -> list[int]:
    """The process ids in names such as ``name (pid N)``."""
    return [int(each.rpartition("pid ")[2].rstrip(")")) for each in who]


def print_report(report: TakeoverReport) -> bool:
    """Print the outcome of a stop on the port; returns whether the wheels were seen to stand."""
    words = describe(report)
    if report.stood:
        print(words)
    else:
        warn(words)
    return report.stood is True


def describe(report: TakeoverReport) -> str:
    """Describe the outcome of a stop on the port."""
    if report.stood is None and (readers := _readers(report.port)):
        return (
            f"{report.port}: a stop was sent, but {' and '.join(readers)} also "
            f"read{'s' if len(readers) == 1 else ''} this port and may have taken the board's "
            f"answers, so the wheels were not seen to stand. End it: {end(readers)}; then "
            f"yahboomd stop --port {report.port}"
        )
    if report.dialect is None:
        from yahboomd.tools.stop.diagnosis import what_was_heard

        return (
            f"{report.port}: the stop of every dialect was sent, but no board answers: whether the "
            f"wheels stand is unknown. {what_was_heard(report.heard)}"
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


def _readers(port: str) -> tuple[str, ...]:
    """Other processes that have the port open."""
    from yahboomd.core.link.port_errors import holders

    return tuple(map(true_names, holders(port)))


def warn(words: str) -> None:
    """Print a warning to standard error."""
    print(f"yahboomd: {pasteable(readable(words))}", file=sys.stderr)
