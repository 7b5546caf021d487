"""A guard's work that a disk may hold up: done in threads, so that no stop waits for it.

The standard library alone is needed.
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any


class DiskWork:
    """Does jobs, of each name one at a time."""

    def __init__(self) -> None:
        self._busy: set[str] = set()
        self._done: deque[tuple[str, Callable[[], object]]] = deque()
        self._wake = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)

    def fileno(self) -> int:
        """A descriptor that is readable while something is to be taken."""
        return self._wake

    def do(self, name: str, job: Callable[[], object], then: Callable[[Any], object] = id) -> None:
        """Begin a job, unless one of that name is not done yet.

        Args:
            then: Called by :meth:`take` with what the job returned, or with its exception.
        """
        if name in self._busy:
            return
        self._busy.add(name)
        # The end of the process waits for no disk.
        thread = threading.Thread(target=self._do, args=(name, job, then), daemon=True)
        try:
            thread.start()
        except RuntimeError:
            # There is no room for a thread: the disk is waited for.
            self._do(name, job, then)

    def take(self) -> None:
        """Go on with what is done."""
        with contextlib.suppress(BlockingIOError):
            os.eventfd_read(self._wake)
        while self._done:
            name, then = self._done.popleft()
            self._busy.discard(name)
            then()

    def _do(self, name: str, job: Callable[[], object], then: Callable[[Any], object]) -> None:
        result: object
        try:
            result = job()
        except Exception as error:  # noqa: BLE001 - the guard goes on, whatever fails
            result = error
        self._done.append((name, partial(then, result)))
        os.eventfd_write(self._wake, 1)
