"""A router of a fleet, and the robots behind it: joined as soon as it is there."""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from pathlib import Path

from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.keys import full_key
from yahboomd.core.bus.options import BusOptions, zenoh_config
from yahboomd.core.errors import BusError

AGAIN_S = 0.5
"""A router that is away is tried again this often."""


class FleetWay(ABC):
    """A router, and the robots behind it.

    Args:
        papers: The person's file; None for a router without access rules.
        places: A fleet, sites and robots behind the router; an empty name is everything there.
    """

    def __init__(self, endpoint: str, papers: Path | None, places: list[str]) -> None:
        self._options = BusOptions(
            mode="client",
            listen=(),
            connect=(endpoint,),
            config_file=papers,
            enforces=False,
            open_timeout_s=10.0,
        )
        self.places = places

    async def run(self) -> None:
        """Work as soon as the router is there.

        Raises:
            BusError: The papers cannot be used.
        """
        zenoh_config(self._options)
        bus = Bus(self._options)
        while True:
            try:
                await bus.open()
                break
            except BusError:
                # The router is away, or refuses the papers: Zenoh does not tell which.
                await asyncio.sleep(AGAIN_S)
                bus = Bus(self._options)
        try:
            await self.work(bus)
        finally:
            await bus.close()

    @abstractmethod
    async def work(self, bus: Bus) -> None:
        """Ask the robots, over the open bus; a lost router comes back by itself."""

    def leads_to(self, robot: str) -> bool:
        return any(not place or f"{robot}/".startswith(f"{place}/") for place in self.places)

    def wide(self, key: str) -> list[str]:
        """A key of every robot behind the router, one selector for each place."""
        return [
            full_key(place + "/*" * (2 - place.count("/")) if place else "**", key)
            for place in self.places
        ]
