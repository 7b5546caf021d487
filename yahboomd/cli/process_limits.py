"""Limits of a process that opens a Zenoh session and listens: files, threads, address space.

With too few of them Zenoh's threads panic, or wait for others that could not be started.
"""

from __future__ import annotations

import logging
import os
import resource
from contextlib import suppress
from pathlib import Path

from yahboomd.core.errors import LimitError

log = logging.getLogger(__name__)

LEAST = 64
"""Descriptors. With fewer, neither the bus nor the port can be relied on, and Zenoh panics."""

ENOUGH = 2048
"""Descriptors. Silent connections take up to 1,100 of them."""

WANTED = 65_536
"""Descriptors. Most systems start a process with 1024, and allow many more."""

THREADS = 20
"""The daemon has 14 with a client, a recorder and an e-stop; Zenoh starts more for many clients."""

ADDRESSES = 1536 << 20
"""Bytes of address space. The daemon reserves up to 0.98 GB and uses 0.06: each thread reserves
64 MB and a stack, and with less a later thread may not start. With 0.1 to 0.5 GB up to 10 of 10
sessions did not open."""


def make_room() -> None:
    """Raise the limit of open files of this process, as far as it may.

    A silent connection holds a descriptor for seconds, even without a certificate. When none is
    left, a lost port cannot be reopened, nor the wheels stopped.

    Raises:
        LimitError: The largest limit that it may have is too low.
    """
    check_limits(who="the daemon")
    hard = allow_files(WANTED, who="the daemon")
    if hard != resource.RLIM_INFINITY and hard < ENOUGH:
        log.warning(
            "This process may open only %d files: connections can take all of them, and then a "
            "lost port is not reopened, nor are the wheels stopped. Allow it %d: "
            "`ulimit -n`, or LimitNOFILE= of a service.",
            hard,
            ENOUGH,
        )


def allow_files(wanted: int, *, who: str) -> int:
    """Raise the limit of open files to ``wanted`` if possible; returns the largest possible one.

    Args:
        who: The program that needs them, for the error.

    Raises:
        LimitError: The largest possible limit is below :data:`LEAST`.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and hard < LEAST:
        raise LimitError(
            f"This process may open {hard} files; {who} needs {LEAST} at least.",
            remedy=f"`ulimit -n {LEAST}` raises the limit of a shell, LimitNOFILE= that of a "
            "service.",
        )
    wanted = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
    return hard


def check_limits(*, who: str) -> None:
    """Check that the threads of a Zenoh session can be started, and that there is memory for them.

    Args:
        who: The program that needs them, for the error.

    Raises:
        LimitError: They cannot.
    """
    most = resource.getrlimit(resource.RLIMIT_AS)[0]
    if most != resource.RLIM_INFINITY and most < ADDRESSES:
        raise LimitError(
            f"This process may use {most >> 20} MB of address space; {who} needs "
            f"{ADDRESSES >> 20} MB, most of which stays empty.",
            remedy="`ulimit -v unlimited` lifts the limit of a shell, LimitAS=infinity that of a "
            "service, whose memory MemoryMax= limits.",
        )
    most = resource.getrlimit(resource.RLIMIT_NPROC)[0]
    # Root's are not limited.
    if most != resource.RLIM_INFINITY and os.getuid() and (there := _threads()) + THREADS > most:
        raise LimitError(
            f"The programs of this user may have {most} threads, and have {there}; {who} needs "
            f"{THREADS} more.",
            remedy="`ulimit -u` raises the limit of a shell, LimitNPROC= that of a service.",
        )


def _threads() -> int:
    found = 0
    for tasks in Path("/proc").glob("[0-9]*/task"):
        with suppress(OSError):  # it ended meanwhile
            if tasks.stat().st_uid == os.getuid():
                found += len(os.listdir(tasks))
    return found
