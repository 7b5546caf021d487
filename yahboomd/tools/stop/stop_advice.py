"""Explains why ``yahboomd stop`` reached no daemon, and what a person can do about it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from yahboomd.core.errors import BusError, LinkError, YahboomdError
from yahboomd.tools.stop.unresponsive import (
    FROZEN,
    daemons,
    is_yahboomd,
    listener,
    process_state,
    reaching,
    serial_ports,
    suspended,
    unresponsive,
)

if TYPE_CHECKING:
    from yahboomd.core.config import Config
    from yahboomd.tools.stop.stop_local import LocalDaemon, LocalStops


class StopOptions(NamedTuple):
    """The options of a stop that name its robot.

    Attributes:
        connect: The endpoints; empty for those of the configuration.
        again: The command to repeat.
    """

    port: str = ""
    namespace: str = ""
    connect: tuple[str, ...] = ()
    again: str = "yahboomd stop"


def not_released(
    error: BusError, asked: StopOptions, found: list[LocalDaemon], endpoints: tuple[str, ...]
) -> BusError:
    """Explain why no daemon answers, by the daemon of this machine that is meant."""
    from yahboomd.tools.stop.stop_local import DaemonChoice, there

    wanted = DaemonChoice(asked.port, asked.namespace or None)
    fitting = [robot for robot in found if wanted.fits(robot) and not asked.connect]
    meant = [robot.pid for robot in fitting if robot.silent or process_state(robot.pid) in FROZEN]
    if (pid := listener(endpoints)) is not None and is_yahboomd(pid):
        meant.insert(0, pid)
    again = asked.again
    for pid in meant:
        if (state := process_state(pid)) in FROZEN:
            message, remedy = suspended(pid, again)
            return type(error)(message, remedy=remedy)
        if pid != 0 and not asked.namespace:
            doing = f" (state {state})" if state else ""
            return type(error)(
                f"{error.message} yahboomd (pid {pid}) runs here and does not answer{doing}.",
                remedy=f"Repeat it: {again}\nIf that does not help, end it: kill {pid}",
            )
    if asked.connect:
        return error
    wanted = DaemonChoice(port=asked.port)
    others = there([robot for robot in found if wanted.fits(robot)], "stop --release")
    return type(error)(error.message, remedy=others or error.remedy)


def no_answer(error: BusError, asked: StopOptions, endpoints: tuple[str, ...]) -> BusError:
    """Explain why no daemon answers, if it runs on this machine."""
    pid = listener(endpoints)
    if pid is None or not is_yahboomd(pid):
        return error
    ports = serial_ports(pid)
    again = f"yahboomd stop --port {ports[0]}" if ports else asked.again
    message, remedy = unresponsive(f"yahboomd (pid {pid})", pid, process_state(pid), again)
    return type(error)(message, remedy=remedy)


def not_found(
    trouble: YahboomdError, config: Config, endpoints: tuple[str, ...], local: LocalStops
) -> YahboomdError:
    """The error if neither a daemon nor a port was found."""
    from yahboomd.tools.stop.stop_local import there

    namespace = config.zenoh.namespace
    below = f" below the namespace {namespace!r}" if namespace else ""
    return type(trouble)(
        f"No daemon answers at {' or '.join(endpoints)}{below}, and {trouble.message}",
        remedy="\n".join(filter(None, (there(local.others, "stop"), *unreached(local))))
        or trouble.remedy,
    )


def silent(robot: LocalDaemon, asked: StopOptions) -> LinkError:
    """The error if this daemon does not answer."""
    state = process_state(robot.pid)
    message, remedy = unresponsive(f"yahboomd (pid {robot.pid})", robot.pid, state, asked.again)
    return LinkError(message, remedy=remedy)


def unreached(local: LocalStops, over_bus: tuple[str, ...] = ()) -> list[str]:
    """Name the daemons of this machine with unknown sockets, and the command that stops each."""
    known = {robot.pid for robot in (*local.answering, *local.silent)}
    if over_bus:
        known.add(listener(over_bus) or 0)
    return [words for pid in daemons() if pid not in known and (words := reaching(pid))]
