"""Unix sockets of this machine: made, asked, and who is at the other end.

The standard library alone is needed.
"""

from __future__ import annotations

import contextlib
import errno
import os
import socket
import struct
from glob import escape, glob
from typing import NamedTuple

from yahboomd.core.link.guard_words import STOP_SOCKET

MODE = 0o660
BACKLOG = 128
_SO_PEERGROUPS = 59
"""Python does not name it; Linux has it since 4.13."""

_MOST_GROUPS = 256
"""Python reads 1024 bytes at most."""

_LONGEST_PATH = 100
"""The address of a Unix socket has room for 107 bytes."""


class Peer(NamedTuple):
    """The process at the other end, as the kernel names it.

    Attributes:
        pid: Its id; 0 if it is in another PID namespace.
        groups: All groups of its user.
    """

    pid: int
    uid: int
    groups: frozenset[int]

    @property
    def user(self) -> str:
        return "root" if self.uid == 0 else f"user {self.uid}"


def bound(fd: int, path: str) -> tuple[socket.socket, os.stat_result]:
    """A socket that listens at a path in a folder that is open, and the state of its file."""
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
    try:
        sock.bind(_address(fd, path))
        # No client can connect before it listens.
        os.chmod(path, MODE)
        sock.listen(BACKLOG)
        return sock, os.lstat(path)
    except BaseException:
        sock.close()
        raise


def peer_of(sock: socket.socket) -> Peer:
    """The user and process at the other end.

    Raises:
        OSError: The connection is gone.
    """
    size = struct.calcsize("iII")
    pid, uid, gid = struct.unpack(
        "iII", sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, size)
    )
    groups = {gid}
    with contextlib.suppress(OSError):
        raw = sock.getsockopt(socket.SOL_SOCKET, _SO_PEERGROUPS, 4 * _MOST_GROUPS)
        groups.update(struct.unpack(f"{len(raw) // 4}I", raw))
    return Peer(pid, uid, frozenset(groups))


def tell_others(folder: str, own: str, verb: bytes, device: int) -> None:
    """Tell the other guards of a folder that this one is the next, or holds a device."""
    for path in glob(f"{escape(folder)}/{STOP_SOCKET}*.sock") if folder else ():
        if path != own:
            with (
                contextlib.suppress(OSError),
                socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK) as sock,
            ):
                connect(sock, path)
                sock.send(b"%s %d\n" % (verb, device), socket.MSG_NOSIGNAL)


def connect(sock: socket.socket, path: str) -> None:
    """Connect to a socket whose path may be longer than an address.

    Raises:
        OSError: No process listens there, or its queue is full.
    """
    fd = os.open(os.path.dirname(path), os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        sock.connect(_address(fd, path))
    finally:
        os.close(fd)


def unlink(path: str) -> None:
    with contextlib.suppress(FileNotFoundError):
        os.unlink(path)


def lives(fd: int, path: str) -> bool:
    """Whether a process listens there; a socket that may not be asked counts as one that does."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK) as probe:
        try:
            probe.connect(_address(fd, path))
        except OSError as error:
            return error.errno not in {errno.ECONNREFUSED, errno.ENOENT}
    return True


def _address(fd: int, path: str) -> str:
    short = len(os.fsencode(path)) <= _LONGEST_PATH
    return path if short else f"/proc/self/fd/{fd}/{os.path.basename(path)}"
