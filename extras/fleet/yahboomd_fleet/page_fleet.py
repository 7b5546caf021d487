"""The robots of a fleet for pages: what each does, and a stop for all of them.

It looks only while a page does. Reading the answers leaves the loop after each of them, so that a
flood delays no beat and no command of the robot that this page drives.
"""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path
from typing import Any

import msgspec

from yahboomd.core.clock import Clock
from yahboomd.core.errors import BusError
from yahboomd_fleet.fleet_feed import FleetFeed
from yahboomd_fleet.fleet_list import read_list
from yahboomd_fleet.fleet_stop import FleetStop
from yahboomd_fleet.fleet_view import FleetView
from yahboomd_fleet.fleet_words import summary
from yahboomd_fleet.stop_all import StopAll

log = logging.getLogger(__name__)

LOOK_S = 10.0
"""Without a page that asks for this time nobody looks any more."""

STOP_S = 60.0
"""A stop asks missing robots again for this time after the last press."""

MOST_ROWS = 1000
"""The robots of one answer: those that need somebody most are the first."""


class PageFleet:
    """The robots of a person's file.

    Args:
        papers: That file.

    Raises:
        ConfigError: It lists no robots.
    """

    def __init__(self, papers: Path, clock: Clock) -> None:
        self._papers = papers
        self._clock = clock
        self._fleet = read_list(papers)
        self._feed: FleetFeed | None = None
        self._looking: asyncio.Task[None] | None = None
        self._asked_s = 0.0
        self._stop: FleetStop | None = None
        self._stopping: asyncio.Task[None] | None = None
        self._running: StopAll | None = None
        self._until_s = 0.0

    def shown(self) -> dict[str, Any]:
        """All robots as they are known now, and the progress of a stop. It begins to look."""
        self._asked_s = asyncio.get_running_loop().time()
        if self._looking is None or self._looking.done():
            view = FleetView(self._fleet.robots)
            self._feed = FleetFeed(self._fleet, self._papers, view, self._clock)
            self._looking = asyncio.create_task(self._look(self._feed), name="web-fleet")
        assert self._feed is not None
        view = self._feed.view
        rows = view.rows(self._clock.now_ns())
        return {
            "summary": summary(rows, view.left_out),
            "robots": [
                {**msgspec.structs.asdict(row), "page": self._fleet.pages.get(row.robot, "")}
                for row in rows[:MOST_ROWS]
            ],
            "stop": [] if self._stop is None else self._stop.report(),
            "stopping": self._stopping is not None and not self._stopping.done(),
        }

    def stop(self) -> None:
        """Stop all of them, as `yahboomd fleet stop` does; again if that is under way."""
        self._until_s = asyncio.get_running_loop().time() + STOP_S
        if self._running is not None and self._stopping is not None and not self._stopping.done():
            self._running.again()
            return
        self._stop = progress = FleetStop(self._fleet.robots)
        self._running = StopAll(self._fleet, self._papers, progress, lambda _: None, self._clock)
        self._stopping = asyncio.create_task(self._run(self._running), name="web-stop-all")

    async def close(self) -> None:
        """End looking and stopping."""
        tasks = [each for each in (self._looking, self._stopping) if each is not None]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _look(self, feed: FleetFeed) -> None:
        running = asyncio.create_task(feed.run(), name="web-fleet-feed")
        loop = asyncio.get_running_loop()
        try:
            while not running.done() and loop.time() - self._asked_s < LOOK_S:
                await asyncio.wait((running,), timeout=1.0)
        finally:
            running.cancel()
            (ended,) = await asyncio.gather(running, return_exceptions=True)
            if isinstance(ended, BusError):
                log.warning("The robots of the fleet are not asked: %s", ended)

    async def _run(self, stop: StopAll) -> None:
        running = asyncio.create_task(stop.run(), name="web-stop-run")
        loop = asyncio.get_running_loop()
        try:
            while not running.done() and loop.time() < self._until_s:
                await asyncio.wait((running,), timeout=1.0)
        finally:
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)
