"""Finds processes by their open files."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path


def processes_with(is_wanted: Callable[[os.stat_result], bool]) -> dict[int, str]:
    """Each process that has such a file open, and its ``/proc/PID/stat``, as far as we may see."""
    found = dict[int, str]()
    for pid in map(int, filter(str.isdigit, os.listdir("/proc"))):
        # It may end now, or be another user's.
        with suppress(OSError):
            for fd in os.listdir(f"/proc/{pid}/fd"):
                with suppress(OSError):
                    if is_wanted(os.stat(f"/proc/{pid}/fd/{fd}")):
                        found[pid] = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8")
                        break
    return found


def name_and_parent(status: str) -> tuple[str, int]:
    """The name and the parent's pid in a ``/proc/PID/stat``."""
    # The name stands in brackets, and may contain brackets itself.
    name, _, rest = status.partition("(")[2].rpartition(")")
    return name, int(rest.split()[1])
