"""Opening and closing Zenoh sessions: the uplink, error messages, stuck connections.

The uplink connects to another router on the machine: a client session, opened when that is there.
yahboomd could join that router as a router, in one session. Measured with eclipse-zenoh 1.10.2,
that does not hold: in one of some hundred starts and ends the tables that routers share broke, on
either side and for good (a panic, or subscriptions that became known after ten seconds or never).
As a client: never in 400. It also keeps the messages between others out of the robot.

Closing: Zenoh sends a goodbye on each connection. If the other side has frozen with its buffers
full, that takes ten seconds and fails; and once it has begun, shutting the socket no longer helps.
So the stuck connections are shut down first. All others are left to Zenoh, which sends their
pending data.
"""

from __future__ import annotations

import asyncio
import logging
import os
import socket
import stat
import struct
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, suppress
from pathlib import Path

import zenoh

from yahboomd.core.bus.blocking import bounded
from yahboomd.core.bus.options import BusOptions, open_offline, short, zenoh_config
from yahboomd.core.errors import BusConfigError, BusError
from yahboomd.core.processes import name_and_parent, processes_with

try:
    import fcntl
    import termios
except ImportError:  # on Windows, where only clients run
    fcntl = None  # type: ignore[assignment]

log = logging.getLogger(__name__)

_LISTENING = "0A"
"""The state of a listening socket in /proc/net/tcp."""


def open_failure(error: zenoh.ZError, options: BusOptions) -> BusError:
    text = str(error)
    if "Address already in use" in text:
        return _in_use(text, options)
    if "Cannot assign requested address" in text:
        return BusError(
            f"This machine has no address {_place(text, options)}, where zenoh.listen wants it.",
            remedy="Use 127.0.0.1 for this machine alone, or one that `ip address` shows.",
        )
    if "Unable to open lock file" in text:
        return BusError(
            f"The Unix socket {_place(text, options)} cannot be made: {short(error)}.",
            remedy="Its folder must exist and be writable.",
        )
    if "Unable to connect" in text:
        return BusError(
            f"No Zenoh router answers at {', '.join(options.connect)}.",
            remedy="Start it first, or set zenoh.mode to 'router', which does not wait.",
        )
    try:
        open_offline(options)
    except BusConfigError as wrong:
        return wrong
    if "Permission denied" in text:
        return BusError(
            f"This user may not listen on {_place(text, options)}.",
            remedy="Ports below 1024 need privileges; a socket's folder must be writable.",
        )
    return BusError(f"The Zenoh session cannot be opened: {short(error)}.")


def port_holder(port: int) -> str | None:
    """The process that listens on a TCP port of this machine, such as ``yahboomd (812)``.

    Returns:
        None if none is found; without privileges, a process of another user is never found.
    """
    inodes = set[int]()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        try:
            lines = Path(table).read_text(encoding="ascii").splitlines()[1:]
        except OSError:
            continue
        for line in lines:
            fields = line.split()
            if fields[3] == _LISTENING and int(fields[1].rpartition(":")[2], 16) == port:
                inodes.add(int(fields[9]))
    found = processes_with(lambda file: stat.S_ISSOCK(file.st_mode) and file.st_ino in inodes)
    return next((f"{name_and_parent(status)[0]} ({pid})" for pid, status in found.items()), None)


def _in_use(text: str, options: BusOptions) -> BusError:
    place = _place(text, options)
    port = place.rpartition(":")[2]
    holder = port_holder(int(port)) if port.isdigit() else None
    owner = f"the process {holder}" if holder else "another process, maybe another user's,"
    return BusError(
        f"The bus cannot listen on {place}: {owner} listens there already.",
        remedy="Is yahboomd running twice? End the other one, or give this one another port, such "
        "as --set zenoh.listen=tcp/127.0.0.1:7449.",
    )


def _place(text: str, options: BusOptions) -> str:
    for endpoint in options.listening:
        if endpoint in text or endpoint.partition("/")[2] in text:
            return endpoint
    return ", ".join(options.listening)


UPLINK_RETRY_S = 0.5
"""The time between two tries. One without an answer costs 0.2 ms."""


async def open_uplink(options: BusOptions) -> zenoh.Session:
    """Open a session to the first router that answers; waits for one for ever.

    Afterwards the session itself reconnects to a router that restarted.
    """
    reported = False
    while True:
        try:
            return await bounded(
                _opening(options),
                timeout_s=options.open_timeout_s,
                name="bus-uplink",
                late=lambda session: session.close(),
            )
        except (zenoh.ZError, TimeoutError) as error:
            if not reported:
                log.debug("No router at %s yet: %s", ", ".join(options.connect), error)
                reported = True
        await asyncio.sleep(UPLINK_RETRY_S)


def _opening(options: BusOptions) -> Callable[[], zenoh.Session]:
    config = zenoh_config(options, uplink=True)
    return lambda: zenoh.open(config)


_PATIENCE_S = 0.1
"""A connection whose other side reads has taken something within this time, also over Wi-Fi."""

_ROUNDS = 5
"""Looks at most: Zenoh may still be filling the buffers at the first."""


def hang_up_stuck(links: Callable[[], Iterable[tuple[str, str]]]) -> list[str]:
    """Shut down the connections on which bytes wait and nothing moves.

    Returns at once if nothing waits, and within half a second in any case.

    Args:
        links: Returns the two ends of each present connection, as Zenoh names them:
            ``tcp/127.0.0.1:7448``.

    Returns:
        The other ends of those that were shut down.
    """
    hung_up = list[str]()
    if fcntl is None or not Path("/proc/self/fd").exists():
        return hung_up  # only Linux shows a process its connections and their queues
    before = dict[tuple[str, str], int]()
    for _ in range(_ROUNDS):
        # Zenoh soon takes a connection that was shut down off its list. Only then may the session
        # be closed: closing would wait for it after all.
        wanted = {(_address(near), _address(far)): far for near, far in links()}
        gone = not any(far in hung_up for far in wanted.values())
        waiting = {pair: unsent for pair, unsent in _unsent(wanted) if unsent}
        if gone and not waiting:
            break
        stuck = {pair for pair, unsent in waiting.items() if unsent >= before.get(pair, unsent + 1)}
        for connection, pair in _sockets(stuck):
            log.info("Hanging up on %s, which takes nothing any more", wanted[pair])
            # The reading half alone: Zenoh takes it for the other side's end and closes the
            # connection in good order. With the writing half shut its two tasks fail at once, and
            # one time in four closing the session hung after all (eclipse-zenoh 1.10.2).
            with suppress(OSError):  # it went away meanwhile
                connection.shutdown(socket.SHUT_RD)
            hung_up.append(wanted[pair])
        before = waiting
        threading.Event().wait(_PATIENCE_S)
    return hung_up


def _unsent(wanted: Iterable[tuple[str, str]]) -> list[tuple[tuple[str, str], int]]:
    found = list[tuple[tuple[str, str], int]]()
    for connection, pair in _sockets(wanted):
        # Bytes that the other side has not acknowledged (SIOCOUTQ has the number of TIOCOUTQ).
        answer = fcntl.ioctl(connection.fileno(), termios.TIOCOUTQ, b"\0" * 4)
        found.append((pair, struct.unpack("i", answer)[0]))
    return found


def _sockets(wanted: Iterable[tuple[str, str]]) -> Iterator[tuple[socket.socket, tuple[str, str]]]:
    """This process's connected sockets between such pairs of addresses, each closed after use."""
    pairs = set(wanted)
    for name in os.listdir("/proc/self/fd"):
        try:
            if not stat.S_ISSOCK(os.fstat(int(name)).st_mode):
                continue
            # The descriptor is Zenoh's: it is looked at, and shut down, through a copy.
            connection = socket.socket(fileno=os.dup(int(name)))
        except OSError:  # closed meanwhile
            continue
        with closing(connection):
            try:
                pair = (_name(connection.getsockname()), _name(connection.getpeername()))
            except OSError:  # it listens, or is no longer connected
                continue
            if pair in pairs:
                yield connection, pair


def _address(endpoint: str) -> str:
    return endpoint.partition("/")[2].split("?")[0].split("#")[0]


def _name(address: object) -> str:
    match address:
        case (str(host), int(port), *_):
            return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
        case _:
            return ""
