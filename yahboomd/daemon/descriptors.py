"""Room for file descriptors, so that those who wait at the bus leave one for the board's port."""

from __future__ import annotations

import resource

WANTED = 65_536
"""Descriptors. Most systems begin a process with 1024, and let it have many more."""


def make_room() -> None:
    """Raise the limit of this process, as far as it may.

    A connection that says nothing holds a descriptor for seconds, without having shown any
    certificate. With none left a port that was lost cannot be opened, nor the wheels stopped.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = WANTED if hard == resource.RLIM_INFINITY else min(WANTED, hard)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
