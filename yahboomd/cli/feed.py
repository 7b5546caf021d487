"""A dashboard that lives: samples come in from a daemon that may come and go."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Self

from yahboomd.bus import keys
from yahboomd.bus.options import BusOptions
from yahboomd.bus.subscriptions import Arrival
from yahboomd.cli.bus_client import MAX_BYTES, BusClient, reach
from yahboomd.cli.dashboard import Dashboard
from yahboomd.cli.view import View
from yahboomd.cli.words import listed
from yahboomd.clock import Clock

PATIENCE_NS = 2_000_000_000
"""A daemon tells its status twice a second: after so long without one, none is there."""


class Feed:
    """Reaches for the bus in the background, and fills a dashboard once it is there.

    An asynchronous context manager; leaving it closes the session.

    Args:
        options: Of a client.
        clock: Stamps what arrives.

    Attributes:
        dashboard: What the samples amount to.
        client: The session, once it is open.
        news: Set when a status or an event came; whoever waits for it clears it.
    """

    def __init__(self, options: BusOptions, clock: Clock) -> None:
        self.options = options
        self.dashboard = Dashboard()
        self.client: BusClient | None = None
        self.news = asyncio.Event()
        self._clock = clock
        self._newest: dict[str, Callable[[], bytes | None]] = {}
        self._why = ""
        self._opened_ns = 0
        self._reaching: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        self._reaching = asyncio.create_task(self._reach(), name="feed-reach")
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._reaching is not None:
            self._reaching.cancel()
            await asyncio.gather(self._reaching, return_exceptions=True)
        if self.client is not None:
            await self.client.close()

    def view(self, now_ns: int) -> View:
        """How things look now; a lost connection is known before the daemon is missed."""
        for key, take in self._newest.items():
            if (payload := take()) is not None:
                self.dashboard.take(key, payload, now_ns)
        connected = self.client is not None and bool(self.client.neighbours)
        return self.dashboard.view(now_ns, connected=connected)

    def check(self) -> None:
        """Raise what makes it impossible ever to reach the bus.

        Raises:
            BusError: A wrong endpoint, namespace or file.
        """
        if self._reaching is not None and self._reaching.done():
            self._reaching.result()

    @property
    def robot(self) -> str:
        """Whom this is about, such as ``bot1 at tcp/127.0.0.1:7448``."""
        name = self.options.namespace or "yahboomd"
        neighbours = () if self.client is None else self.client.neighbours
        known = tuple(each.address for each in neighbours if each.address)
        return f"{name} at {listed(known or self.options.connect)}"

    @property
    def wanted(self) -> str:
        """Where it is looked for."""
        return listed(self.options.connect)

    @property
    def why(self) -> str:
        """Why nothing comes yet, where something is known about it."""
        if self.client is None:
            return self._why
        if not self.client.neighbours:
            return f"The connection to {self.wanted} is lost; it is made again by itself."
        if self._clock.now_ns() - self._opened_ns < PATIENCE_NS:
            return "The connection is there; listening …"
        below = f" below the namespace {self.options.namespace!r}" if self.options.namespace else ""
        return (
            f"A Zenoh router answers, but no yahboomd speaks there{below}. "
            "Is it another --namespace?"
        )

    async def _reach(self) -> None:
        client = await reach(self.options, waiting=self._waiting)
        self.client, self._opened_ns = client, self._clock.now_ns()
        for key in (keys.STATUS, keys.EVENTS, keys.BATTERY):
            client.subscribe(key, self._take, max_bytes=MAX_BYTES)
        self._newest = {key: client.newest(key) for key in (keys.POSE, keys.TWIST, keys.WHEELS)}

    def _waiting(self, why: str) -> None:
        self._why = why

    def _take(self, arrivals: list[Arrival]) -> None:
        for arrival in arrivals:
            self.dashboard.take(arrival.key, arrival.payload, arrival.arrived_ns)
            if arrival.key in {keys.STATUS, keys.EVENTS}:
                self.news.set()
