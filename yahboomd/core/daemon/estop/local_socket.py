"""A Unix socket of the daemon's own in the runtime directory: who made it, and who may use it."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import socket
import struct
from pathlib import Path
from typing import NamedTuple

from yahboomd.core.daemon.folder import prepare_folder

MODE = 0o660
BACKLOG = 128
NAMES_TRIED = 9
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


class Listening(NamedTuple):
    """A socket that listens, and its file.

    Attributes:
        sock: The socket, not blocking.
        inode: The inode of its file.
        group: Its group; members may use it.
    """

    sock: socket.socket
    path: Path
    inode: int
    group: int

    def close(self) -> None:
        """Close it, and remove its file unless it is another daemon's by now."""
        self.sock.close()
        with contextlib.suppress(OSError):
            if self.is_there():
                self.path.unlink()

    def is_there(self) -> bool:
        """Whether programs find it: its file is not gone, nor another daemon's. Blocks.

        Raises:
            OSError: The folder cannot be looked into.
        """
        try:
            return os.lstat(self.path).st_ino == self.inode
        except (FileNotFoundError, NotADirectoryError):
            return False

    def may_use(self, peer: Peer) -> bool:
        """Whether a process may: root, the daemon's own user, and members of the file's group."""
        return peer.uid in {0, os.geteuid()} or self.group in peer.groups


def listen(folder: Path, name: str) -> Listening:
    """Listen on ``name.sock`` in a folder, or on ``name-PID.sock`` if another daemon has that.

    A socket that a killed daemon left behind is replaced. Blocks for as long as the disk does.

    Raises:
        OSError: The folder cannot be used, or no name is free.
    """
    prepare_folder(folder)
    fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        # Two daemons that start at once must not take each other's file for a dead one's. Somebody
        # who may read the folder could hold the lock for ever, so it is not waited for.
        with contextlib.suppress(BlockingIOError):
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        for old in folder.glob(f"{name}-*.sock"):
            if not _lives(fd, old):
                old.unlink(missing_ok=True)
        own = f"{name}-{os.getpid()}"
        for stem in (name, own, *(f"{own}-{n}" for n in range(2, NAMES_TRIED))):
            path = folder / f"{stem}.sock"
            if not _lives(fd, path):
                path.unlink(missing_ok=True)
                return _bound(fd, path)
    finally:
        os.close(fd)
    raise OSError(errno.EADDRINUSE, f"other daemons have every name {folder}/{name}-*.sock")


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


def _bound(fd: int, path: Path) -> Listening:
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
    try:
        sock.bind(_address(fd, path))
        # No client can connect before it listens.
        os.chmod(path, MODE)
        sock.listen(BACKLOG)
        status = os.lstat(path)
    except BaseException:
        sock.close()
        raise
    return Listening(sock, path, status.st_ino, status.st_gid)


def _lives(fd: int, path: Path) -> bool:
    """Whether a process listens there; a socket that may not be asked counts as one that does."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK) as probe:
        try:
            probe.connect(_address(fd, path))
        except OSError as error:
            return error.errno not in {errno.ECONNREFUSED, errno.ENOENT}
    return True


def _address(fd: int, path: Path) -> str:
    text = str(path)
    short = len(os.fsencode(text)) <= _LONGEST_PATH
    return text if short else f"/proc/self/fd/{fd}/{path.name}"
