"""A call that may block, kept off the loop and bounded in time."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from typing import TypeVar

Result = TypeVar("Result")


async def bounded(
    call: Callable[[], Result],
    *,
    timeout_s: float,
    name: str,
    late: Callable[[Result], None] | None = None,
) -> Result:
    """Run ``call`` in a thread of its own and wait for it no longer than ``timeout_s``.

    The thread is a daemon: unlike one of an executor's it keeps neither the loop nor the process
    from ending when the call never returns.

    Args:
        call: What to run.
        timeout_s: The longest wait, in seconds.
        name: The thread's name.
        late: Given the result when nobody waits for it any more (called in the thread).

    Raises:
        TimeoutError: The call had not returned in time. It goes on in its thread.
        Exception: Whatever the call raised.
    """
    loop = asyncio.get_running_loop()
    future: asyncio.Future[Result] = loop.create_future()

    def settle(result: Result | None, error: BaseException | None) -> None:
        if future.done():
            if error is None and late is not None:
                threading.Thread(target=late, args=(result,), name=name, daemon=True).start()
        elif error is not None:
            future.set_exception(error)
        else:
            future.set_result(result)  # type: ignore[arg-type]

    def run() -> None:
        result: Result | None = None
        error: BaseException | None = None
        try:
            result = call()
        except BaseException as caught:  # noqa: BLE001 - raised again where it is awaited
            error = caught
        try:
            loop.call_soon_threadsafe(settle, result, error)
        except RuntimeError:  # the loop has ended
            if error is None and late is not None:
                late(result)  # type: ignore[arg-type]

    threading.Thread(target=run, name=name, daemon=True).start()
    # Not wait_for: up to Python 3.11 it forgets a cancellation that comes with the result.
    try:
        async with asyncio.timeout(timeout_s):
            return await future
    except (asyncio.CancelledError, TimeoutError):
        if future.done() and not future.cancelled() and future.exception() is None:
            settle(future.result(), None)
        raise
