"""Moves without asyncio: waited for in the robot's own thread."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any

import pytest

from yahboomd.client.plain_robot import PlainMoveRun
from yahboomd.core.errors import BusError


class Run:
    """Moves with two samples of progress."""

    def __init__(self) -> None:
        self.calls: list[str] = []
        self.left = [1, 2]

    async def _called(self, name: str) -> str:
        self.calls.append(name)
        return name

    def __getattr__(self, name: str) -> Any:
        return lambda: self._called(name)

    async def __anext__(self) -> int:
        if not self.left:
            raise StopAsyncIteration
        return self.left.pop(0)


def wait(work: Coroutine[Any, Any, Any]) -> Any:
    return asyncio.run(work)


def test_a_block_starts_follows_and_ends_them() -> None:
    run = Run()
    with PlainMoveRun(run, wait) as moves:  # type: ignore[arg-type]
        assert list(moves) == [1, 2]
        assert moves.finished() == "finished"
        moves.pause()
        moves.resume()
    assert run.calls == ["start", "finished", "pause", "resume", "end"]
    moves.end()
    assert run.calls[-1] == "end"


def test_an_exception_in_the_block_ends_them() -> None:
    run = Run()
    with pytest.raises(LookupError), PlainMoveRun(run, wait):  # type: ignore[arg-type]
        raise LookupError
    assert run.calls == ["start", "end"]


def test_a_robot_that_was_closed_meanwhile_has_ended_them() -> None:
    def closed(work: Coroutine[Any, Any, Any]) -> Any:
        if run.calls:
            work.close()
            raise BusError("The robot is not open.")
        return asyncio.run(work)

    run = Run()
    with PlainMoveRun(run, closed):  # type: ignore[arg-type]
        pass
    assert run.calls == ["start"]
