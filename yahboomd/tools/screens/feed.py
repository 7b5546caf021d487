"""Fills a dashboard with a daemon's samples; the daemon may come and go."""

from __future__ import annotations

import asyncio
import math
from typing import Self

from yahboomd.client import AsyncRobot
from yahboomd.client.streams import MAX_BYTES, Newest
from yahboomd.core.bus import keys
from yahboomd.core.bus.options import BusOptions
from yahboomd.core.bus.presence import Neighbour
from yahboomd.core.bus.subscriptions import Arrival
from yahboomd.core.clock import Clock
from yahboomd.core.program import pasteable
from yahboomd.tools.screens.dashboard import Dashboard, View
from yahboomd.tools.stop.unresponsive import suspended_listener
from yahboomd.tools.terminal.words import listed

SEARCH_NS = 1_000_000_000
"""The time between two searches for a suspended daemon on this machine."""


class Feed:
    """Connects in the background, and fills a dashboard once the bus is there.

    An asynchronous context manager; leaving it closes the session.

    Attributes:
        dashboard: Makes views of the samples.
        client: The robot; its session opens when a router answers.
        news: Set when a status or an event came; the waiting task clears it.
    """

    def __init__(
        self, options: BusOptions, clock: Clock, *, source: str = keys.CMD_VEL, label: str = ""
    ) -> None:
        self.options = options
        self.dashboard = Dashboard()
        self.client = AsyncRobot(options, source=source, label=label, clock=clock)
        self.news = asyncio.Event()
        self._clock = clock
        self._search_ns = 0
        self._suspended: int | None = None
        self._newest: dict[str, Newest] = {}
        self._reaching: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        self._reaching = asyncio.create_task(self._reach(), name="feed-reach")
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._reaching is not None:
            self._reaching.cancel()
            await asyncio.gather(self._reaching, return_exceptions=True)
        await self.client.close()

    def view(self, now_ns: int) -> View:
        """The view at this moment. A lost connection shows before statuses are overdue."""
        for key, newest in self._newest.items():
            if (payload := newest.take()) is not None:
                self.dashboard.accept(key, payload, now_ns)
        return self.dashboard.view(now_ns, connected=bool(self._neighbours))

    def check(self) -> None:
        """Raise if the bus can never be reached with these options.

        Raises:
            BusError: A wrong endpoint, namespace or file.
        """
        if self._reaching is not None and self._reaching.done():
            self._reaching.result()

    @property
    def robot(self) -> str:
        """The robot and its address, such as ``bot1 at tcp/127.0.0.1:7448``."""
        name = self.options.namespace or "yahboomd"
        known = tuple(each.address for each in self._neighbours if each.address)
        return f"{name} at {listed(known or self.options.connect)}"

    @property
    def _neighbours(self) -> tuple[Neighbour, ...]:
        return self.client.bus.neighbours if self.client.is_open else ()

    @property
    def wanted(self) -> str:
        """The expected endpoints of the daemon."""
        return listed(self.options.connect)

    @property
    def why(self) -> str:
        """The reason why no sample has come yet, if it is known; else empty."""
        problem = self.client.problem
        if self.client.is_open:
            return (
                f"{problem} Is it another --namespace?" if "router answers" in problem else problem
            )
        if (now_ns := self._clock.now_ns()) >= self._search_ns:
            # The search reads files of all processes, so not at each drawing.
            self._search_ns = now_ns + SEARCH_NS
            self._suspended = suspended_listener(self.options.connect)
        if (pid := self._suspended) is not None:
            return (
                f"yahboomd (pid {pid}) listens at {self.wanted} and is suspended. "
                f"Continue it with `fg` or `kill -CONT {pid}`."
            )
        return pasteable(f"{problem} `yahboomd run` starts a daemon.") if problem else ""

    async def _reach(self) -> None:
        await self.client.join(math.inf)
        bus = self.client.bus
        for key in (keys.STATUS, keys.EVENTS, keys.BATTERY):
            bus.subscribe(key, self._accept, max_bytes=MAX_BYTES)
        self._newest = {key: Newest(bus, key) for key in (keys.POSE, keys.TWIST, keys.WHEELS)}

    def _accept(self, arrivals: list[Arrival]) -> None:
        for arrival in arrivals:
            self.dashboard.accept(arrival.key, arrival.payload, arrival.arrived_ns)
            if arrival.key in {keys.STATUS, keys.EVENTS}:
                self.news.set()
