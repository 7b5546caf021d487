"""Calls that may block, kept off the loop: one bounded in time, or many in order in a thread.

While a connection is full, Zenoh blocks every call whose data it must not drop: a frozen subscriber
held ``put`` for five seconds, until its connection was closed.
"""

from __future__ import annotations

import asyncio
import atexit
import logging
import queue
import threading
from collections.abc import Callable
from typing import TypeVar

from yahboomd.core.clock import SystemClock, nanoseconds, seconds, timeout

log = logging.getLogger(__name__)

Result = TypeVar("Result")

EXIT_S = 2.0
"""The longest that the end of the process waits for running calls."""

_running = set[threading.Thread]()


@atexit.register
def _await_calls() -> None:
    """Let calls return before the interpreter is torn down.

    A thread that returns from Zenoh during it is ended by unwinding through Rust, which aborts
    the process (signal 6) instead of ending it with its status.
    """
    clock = SystemClock()
    deadline_ns = clock.now_ns() + nanoseconds(EXIT_S)
    for thread in list(_running):
        thread.join(max(0.0, seconds(deadline_ns - clock.now_ns())))


def _start(run: Callable[[], None], name: str) -> None:
    def enter() -> None:
        thread = threading.current_thread()
        _running.add(thread)
        try:
            run()
        finally:
            _running.discard(thread)

    threading.Thread(target=enter, name=name, daemon=True).start()


async def bounded(
    call: Callable[[], Result],
    *,
    timeout_s: float,
    name: str,
    late: Callable[[Result], None] | None = None,
) -> Result:
    """Run ``call`` in a thread of its own and wait for it no longer than ``timeout_s``.

    The thread is a daemon: unlike one of an executor's it keeps neither the loop nor, for longer
    than ``EXIT_S``, the process from ending when the call never returns.

    Args:
        late: Called in the thread with a result that came after the timeout.

    Raises:
        TimeoutError: The call had not returned in time. It continues in its thread.
        Exception: Any exception of the call.
    """
    loop = asyncio.get_running_loop()
    future: asyncio.Future[Result] = loop.create_future()

    def settle(result: Result | None, error: BaseException | None) -> None:
        if future.done():
            if error is None and late is not None:
                _start(lambda: late(result), name)  # type: ignore[arg-type]
        elif error is not None:
            future.set_exception(error)
        else:
            future.set_result(result)  # type: ignore[arg-type]

    def run() -> None:
        result: Result | None = None
        error: BaseException | None = None
        try:
            result = call()
        except BaseException as caught:  # noqa: BLE001 - raised again by the await
            error = caught
        try:
            loop.call_soon_threadsafe(settle, result, error)
        except RuntimeError:  # the loop has ended
            if error is None and late is not None:
                late(result)  # type: ignore[arg-type]

    _start(run, name)
    # Not wait_for: up to Python 3.11 it forgets a cancellation that comes with the result.
    try:
        async with timeout(timeout_s):
            return await future
    except (asyncio.CancelledError, TimeoutError):
        if future.done() and not future.cancelled() and future.exception() is None:
            settle(future.result(), None)
        raise


_WAITING = 256
"""Calls that may wait for the thread; more are refused at once."""


class Sender:
    """One thread and its bounded queue. The thread starts with the first call."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._work: queue.Queue[Callable[[], object] | None] = queue.Queue(_WAITING)
        self._thread: threading.Thread | None = None
        self._lock = threading.Lock()
        self._failed = False

    def send(self, work: Callable[[], object]) -> bool:
        """Have the thread call ``work``; from any thread. The first exception is logged.

        Returns:
            False if the queue is full, or no thread can be started now: ``work`` is not called.
        """
        with self._lock:
            if self._thread is None:
                # A daemon: stuck in a full connection, it does not keep the process from ending.
                thread = threading.Thread(target=self._run, name=self._name, daemon=True)
                try:
                    thread.start()
                except RuntimeError:
                    return False
                self._thread = thread
        try:
            self._work.put_nowait(work)
        except queue.Full:
            return False
        return True

    def close(self, timeout_s: float) -> bool:
        """Make the waiting calls and end the thread; blocks for twice ``timeout_s`` at most.

        Returns:
            Whether the thread has ended.
        """
        # A first call at the same moment may be starting it: that thread cannot be joined.
        with self._lock:
            thread = self._thread
        if thread is None:
            return True
        try:
            self._work.put(None, timeout=timeout_s)
        except queue.Full:
            return False
        thread.join(timeout_s)
        return not thread.is_alive()

    def _run(self) -> None:
        while (work := self._work.get()) is not None:
            try:
                work()
            except BaseException:
                # A panic of Zenoh's is no Exception. Later calls are still made.
                if not self._failed:
                    log.exception("A call of %s failed; others go on", self._name)
                self._failed = True
