"""The priorities of simulated boards and daemons among what keeps a machine busy."""

from __future__ import annotations

import os
import subprocess

DAEMON_NICE = -5
"""The unit's value."""

BOARD_NICE = -15
"""A real board has a processor of its own, so other processes must not delay it."""


def prefer(process: subprocess.Popen[str] | subprocess.Popen[bytes], nice: int) -> None:
    """Give a process a higher priority than this one has, if that is permitted."""
    try:
        own = os.getpriority(os.PRIO_PROCESS, 0)
        os.setpriority(os.PRIO_PROCESS, process.pid, max(-20, own + nice))
    except OSError:
        pass
