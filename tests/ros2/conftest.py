"""A bus on a port of its own, applications that reach it, and the oracle of ROS 2's bytes."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable

import pytest
from real_robot import client, real_robot
from ros_oracle import oracle, ros
from zenoh_fixtures import ZenohApp, free_endpoint, zenoh_app

from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.options import BusOptions

__all__ = ["client", "oracle", "real_robot", "ros", "zenoh_app"]


@pytest.fixture
async def bus() -> AsyncIterator[Bus]:
    """An open bus that joins no router, below the namespace bot1."""
    async with Bus(BusOptions(listen=(free_endpoint(),), connect=(), namespace="bot1")) as bus:
        yield bus


@pytest.fixture
def app(bus: Bus, zenoh_app: Callable[..., ZenohApp]) -> ZenohApp:
    """An application on it."""
    return zenoh_app("client", bus.options.listen[0])
