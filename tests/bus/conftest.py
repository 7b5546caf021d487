"""Fixtures of the bus's tests: an open bus on a port of its own, and applications to reach it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from zenoh_fixtures import PATIENCE_S, free_endpoint, zenoh_app, zenoh_router

from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.options import BusOptions

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

__all__ = ["bus", "zenoh_app", "zenoh_router"]


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
