"""Hanging up on those who take nothing any more, before the session is closed.

Zenoh says goodbye on each connection. Where the other side has frozen with its buffers full, that
takes ten seconds and fails; and once it has begun, shutting the socket no longer helps. So the
stuck connections are shut down first. All others are left to Zenoh, which sends what is pending.
"""

from __future__ import annotations

import fcntl
import logging
import os
import socket
import stat
import struct
import termios
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, suppress

log = logging.getLogger(__name__)

_PATIENCE_S = 0.1
"""A connection whose other side reads has taken something within this time, also over Wi-Fi."""

_ROUNDS = 5
"""Looks at most: Zenoh may still be filling the buffers at the first."""


def hang_up_stuck(links: Callable[[], Iterable[tuple[str, str]]]) -> list[str]:
    """Shut down the connections on which bytes wait and nothing moves.

    Returns at once where nothing waits, and within half a second in any case.

    Args:
        links: Asks for the two ends of each connection that there is now, as Zenoh names them:
            ``tcp/127.0.0.1:7448``.

    Returns:
        The other ends of those that were shut down.
    """
    hung_up = list[str]()
    before = dict[tuple[str, str], int]()
    for _ in range(_ROUNDS):
        # Zenoh takes a connection that was shut down off its list soon, and not before may the
        # session be closed: closing would wait for it after all.
        wanted = {(_address(near), _address(far)): far for near, far in links()}
        gone = not any(far in hung_up for far in wanted.values())
        waiting = {pair: unsent for pair, unsent in _unsent(wanted) if unsent}
        if gone and not waiting:
            break
        stuck = {pair for pair, unsent in waiting.items() if unsent >= before.get(pair, unsent + 1)}
        for connection, pair in _sockets(stuck):
            log.info("Hanging up on %s, which takes nothing any more", wanted[pair])
            # The reading half alone: Zenoh takes it for the other side's end and gives up the
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


def _sockets(
    wanted: Iterable[tuple[str, str]],
) -> Iterator[tuple[socket.socket, tuple[str, str]]]:
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
