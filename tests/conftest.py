"""What tests of every room may use."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from typing import Any

import pytest
from real_robot import client, real_robot
from zenoh_fixtures import zenoh_router

from yahboomd.simulation import virtual_time

__all__ = ["client", "real_robot", "virtual_time_run", "zenoh_router"]


@pytest.fixture
def virtual_time_run() -> Callable[[Coroutine[Any, Any, Any]], Any]:
    """Runs a coroutine on an event loop whose time jumps to the next timer: no waiting.

    A whole test can run so with the decorator ``yahboomd.simulation.virtual_time.on_virtual_time``.
    """
    return virtual_time.run
