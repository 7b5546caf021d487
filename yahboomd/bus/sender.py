"""A thread that does what may block, in order, so that the loop never waits for a connection.

Zenoh holds back what it must not drop while a connection is full: a subscriber that froze
held ``put`` for five seconds, until its connection was given up.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable

_WAITING = 256
"""Calls that wait for the thread; beyond it the call is refused at once."""


class Sender:
    """One thread and its bounded queue. The thread starts with the first call.

    Args:
        name: The thread's name.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._work: queue.Queue[Callable[[], object] | None] = queue.Queue(_WAITING)
        self._thread: threading.Thread | None = None
        self._lock = threading.Lock()

    def send(self, work: Callable[[], object]) -> bool:
        """Have ``work``, which must not raise, done by the thread; from any thread.

        Returns:
            False when too much waits already: it will not be done.
        """
        with self._lock:
            if self._thread is None:
                # A daemon: stuck in a full connection, it does not keep the process from ending.
                self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
                self._thread.start()
        try:
            self._work.put_nowait(work)
        except queue.Full:
            return False
        return True

    def close(self, timeout_s: float) -> bool:
        """Do what waits and end the thread; blocks, but not much longer than ``timeout_s``.

        Returns:
            Whether the thread has ended.
        """
        if self._thread is None:
            return True
        try:
            self._work.put(None, timeout=timeout_s)
        except queue.Full:
            return False
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while (work := self._work.get()) is not None:
            work()
