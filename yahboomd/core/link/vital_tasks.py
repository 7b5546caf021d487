"""Tasks that live and die together, and work that no cancellation ends early."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Coroutine
from typing import Any, NoReturn

from yahboomd.core.errors import YahboomdError


class VitalTasks:
    """Tasks that must not end one before the other, as they may in a TaskGroup."""

    def __init__(self) -> None:
        self._group = asyncio.TaskGroup()
        self._tasks: list[asyncio.Task[None]] = []
        self._over = asyncio.Event()
        self._error: Exception | None = None

    @contextlib.asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Run the tasks as long as the body, and the body as long as all of them.

        Raises:
            Exception: The error that ended them: a mistake of this program, or the first other one.
        """
        try:
            async with self._group:
                try:
                    yield
                finally:
                    for task in self._tasks:
                        task.cancel()
        except BaseExceptionGroup as group:
            raise _cause(group) from None

    def start(self, work: Coroutine[Any, Any, None], name: str) -> None:
        task = self._group.create_task(work, name=name)
        task.add_done_callback(self._ended)
        self._tasks.append(task)

    def fail(self, error: Exception) -> None:
        """End all of them with an error; only the first one counts."""
        if self._error is None:
            self._error = error
            self._over.set()

    async def failure(self) -> NoReturn:
        await self._over.wait()
        assert self._error is not None
        raise self._error

    def _ended(self, task: asyncio.Task[None]) -> None:
        if task.cancelled() or task.exception() is None:
            self.fail(RuntimeError(f"the task {task.get_name()} ended by itself"))


def _cause(group: BaseExceptionGroup[BaseException]) -> BaseException:
    known, unknown = group.split(YahboomdError)
    error: BaseException = unknown or known or group
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    return error


async def undisturbed(work: Coroutine[Any, Any, None]) -> None:
    """Finish ``work``, which is bounded in time, even if the caller is cancelled."""
    task = asyncio.ensure_future(work)
    disturbance: asyncio.CancelledError | None = None
    while not task.done():
        try:
            await asyncio.shield(task)
        except asyncio.CancelledError as error:
            disturbance = error
    task.result()
    if disturbance is not None:
        raise disturbance
