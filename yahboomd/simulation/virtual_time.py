"""An event loop whose time jumps: waiting for a timer takes no real time.

When nothing is ready to run, the loop's time moves to the next timer at once. Files, sockets and
threads still work, but take no virtual time: work handed to a thread may find that timers have
run meanwhile.
"""

from __future__ import annotations

import asyncio
import functools
import math
import selectors
from collections.abc import Callable, Coroutine, Mapping
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from yahboomd.core.clock import Alarm, LoopAlarm
from yahboomd.core.model import NS_PER_S

if TYPE_CHECKING:
    from _typeshed import FileDescriptorLike

T = TypeVar("T")
P = ParamSpec("P")

START_NS = 1_000 * NS_PER_S
"""The start of virtual time: not 0, which hides mistakes."""

REAL_PATIENCE_S = 60.0
"""The real time to wait for a thread or a socket when no timer is left."""


class Deadlock(RuntimeError):
    """Nothing is ready, no timer is left, and no file or socket became ready."""


class _Selector(selectors.BaseSelector):
    """Looks at real files without waiting, then moves the time instead."""

    def __init__(self) -> None:
        self._real = selectors.DefaultSelector()
        self._files = 0
        self.now_ns = START_NS

    def register(
        self, fileobj: FileDescriptorLike, events: int, data: object = None
    ) -> selectors.SelectorKey:
        key = self._real.register(fileobj, events, data)
        self._files += 1
        return key

    def unregister(self, fileobj: FileDescriptorLike) -> selectors.SelectorKey:
        key = self._real.unregister(fileobj)
        self._files -= 1
        return key

    def modify(
        self, fileobj: FileDescriptorLike, events: int, data: object = None
    ) -> selectors.SelectorKey:
        return self._real.modify(fileobj, events, data)

    def get_map(self) -> Mapping[FileDescriptorLike, selectors.SelectorKey]:
        return self._real.get_map()

    def close(self) -> None:
        self._real.close()

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        # The loop's own pipe only wakes a waiting loop, and this one never waits.
        ready = self._real.select(0) if self._files > 1 else []
        if ready or timeout == 0:
            return ready
        if timeout is None:
            ready = self._real.select(REAL_PATIENCE_S)
            if not ready:
                raise Deadlock("every task waits for something that no timer will bring")
            return ready
        self.now_ns += max(1, math.ceil(timeout * NS_PER_S))
        return []


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """An event loop whose ``time()`` is virtual."""

    def __init__(self) -> None:
        # The base class asks for the time while it is being made.
        self._virtual = _Selector()
        super().__init__(self._virtual)

    def time(self) -> float:
        """Virtual seconds."""
        return self._virtual.now_ns / NS_PER_S

    async def shutdown_default_executor(self, timeout: float | None = None) -> None:  # noqa: ARG002, ASYNC109
        """Wait for its threads as long as it takes: their time is real."""
        await super().shutdown_default_executor()

    def freeze(self, for_s: float) -> None:
        """Advance the time while nothing runs, as in a process that is stopped and continued."""
        self._virtual.now_ns += round(for_s * NS_PER_S)


def run(main: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine on a fresh virtual-time loop and return its result.

    Raises:
        Deadlock: It waits for something that never comes.
        RuntimeError: It has left tasks behind.
    """
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(_leaving_nothing(main))


async def _leaving_nothing(main: Coroutine[Any, Any, T]) -> T:
    result = await main
    # Yield once, so that tasks that were cancelled last can end.
    await asyncio.sleep(0)
    left = asyncio.all_tasks() - {asyncio.current_task()}
    if left:
        names = ", ".join(sorted(task.get_name() for task in left if task is not None))
        raise RuntimeError(f"tasks were left running: {names}")
    return result


def on_virtual_time(test: Callable[P, Coroutine[Any, Any, T]]) -> Callable[P, T]:
    """Turn a coroutine function into a plain one that runs on virtual time, for tests."""

    @functools.wraps(test)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> T:
        return run(test(*args, **kwargs))

    return wrapper


class LoopClock:
    """The running event loop's own time, which a virtual-time loop controls.

    Wall time runs beside it from ``epoch_ns``, so that samples carry plausible stamps.
    """

    def __init__(self, epoch_ns: int = 1_700_000_000 * NS_PER_S) -> None:
        self._epoch_ns = epoch_ns
        self.slept_ns = 0
        """The time a suspended machine slept, as a test pretends."""

    def now_ns(self) -> int:
        """The loop's time."""
        return round(asyncio.get_running_loop().time() * NS_PER_S)

    def wall_ns(self) -> int:
        """The epoch plus the loop's time."""
        return self._epoch_ns + self.now_ns()

    def suspended_ns(self) -> int:
        """The time a suspended machine slept, as a test pretends."""
        return self.slept_ns

    def alarm(self, callback: Callable[[], None]) -> Alarm:
        """An alarm on the loop's own timers."""
        return LoopAlarm(callback)
