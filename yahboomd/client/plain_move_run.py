"""Moves that are being driven, for programs without asyncio."""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from yahboomd.client.move_messages import MoveSample
from yahboomd.client.move_run import MoveRun
from yahboomd.core.errors import BusError

if TYPE_CHECKING:
    from typing_extensions import Self


class PlainMoveRun:
    """Moves in a row: ``with robot.moves(...) as run:``, made by ``Robot.moves``.

    Entering asks for them; leaving ends them, if they are not over. ``for progress in run:``
    follows them to their end.

    Args:
        run: The same for asyncio.
        wait: Waits for a coroutine in the thread of the robot.
    """

    def __init__(self, run: MoveRun, wait: Callable[[Coroutine[Any, Any, Any]], Any]) -> None:
        self._run = run
        self._wait = wait

    def __enter__(self) -> Self:
        self._wait(self._run.start())
        return self

    def __exit__(self, *_: object) -> None:
        # A robot that was closed meanwhile has ended them.
        with suppress(BusError):
            self._wait(self._run.end())

    def __iter__(self) -> Iterator[MoveSample]:
        async def following() -> MoveSample | None:
            return await anext(self._run, None)

        while (sample := self._wait(following())) is not None:
            yield sample

    def finished(self) -> MoveSample:
        """Wait for the goal; raises as ``MoveRun.finished`` does."""
        sample: MoveSample = self._wait(self._run.finished())
        return sample

    def pause(self) -> None:
        """Make the robot stop on its way."""
        self._wait(self._run.pause())

    def resume(self) -> None:
        """Continue paused moves."""
        self._wait(self._run.resume())

    def end(self) -> None:
        """End the moves, if they are not over: the robot stops."""
        self._wait(self._run.end())
