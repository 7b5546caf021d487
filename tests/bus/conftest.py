"""An open bus, and an application to reach it: on sessions in memory where `fake_zenoh` is used."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

import pytest
from fake_zenoh import fake_zenoh
from zenoh_fixtures import PATIENCE_S, ZenohApp, free_endpoint, zenoh_app, zenoh_router

from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.options import BusOptions

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Awaitable, Callable

__all__ = ["app", "bus", "fake_zenoh", "zenoh_app", "zenoh_router"]


@pytest.fixture
async def bus() -> AsyncIterator[Bus]:
    """An open bus that joins no router."""
    options = BusOptions(
        listen=(free_endpoint(),),
        connect=(),
        namespace="bot1",
        lease_s=PATIENCE_S,
        close_timeout_s=PATIENCE_S,
    )
    async with Bus(options) as bus:
        yield bus


@pytest.fixture
def app(bus: Bus, zenoh_app: Callable[..., ZenohApp]) -> ZenohApp:
    """An application that is a client of that bus."""
    return zenoh_app("client", bus.options.listen[0])


@pytest.fixture
def turns() -> Callable[[], Awaitable[None]]:
    """Lets the loop deliver all that waits for it."""

    async def take() -> None:
        for _ in range(8):
            await asyncio.sleep(0)

    return take
