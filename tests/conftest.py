"""What tests of every room may use."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from typing import Any

import pytest
from real_robot import client, real_robot
from zenoh_fixtures import zenoh_router

from yahboomd.simulation import virtual_time

__all__ = ["client", "real_robot", "virtual_time_run", "zenoh_router"]


@pytest.fixture
async def tasks_end() -> AsyncIterator[None]:
    """Set up before all else and torn down after it: whatever still runs then was left behind."""
    yield
    # Those that were cancelled last get the turns that they need to end.
    for _ in range(10):
        await asyncio.sleep(0)
    left = asyncio.all_tasks() - {asyncio.current_task()}
    assert not left, f"tasks were left behind: {', '.join(task.get_name() for task in left)}"


@pytest.fixture(autouse=True)
def no_task_is_left_behind(request: pytest.FixtureRequest) -> None:
    """A leaked task fails its test, on a real loop as on virtual time."""
    if request.node.get_closest_marker("asyncio") is not None:
        request.getfixturevalue("tasks_end")


@pytest.fixture
def virtual_time_run() -> Callable[[Coroutine[Any, Any, Any]], Any]:
    """Runs a coroutine on an event loop whose time jumps to the next timer: no waiting.

    A whole test can run so with the decorator ``yahboomd.simulation.virtual_time.on_virtual_time``.
    """
    return virtual_time.run
