"""Asks the robots of a fleet for their status, over the routers that lead to them.

One query reaches all robots of a router. A site's router is asked only while some robot behind it
does not answer over the one above. Answers wait in Zenoh's threads, the newest of each robot alone,
so that a flood of them costs the loop no more than one look at each robot.
"""

from __future__ import annotations

import asyncio
import threading
from contextlib import suppress
from functools import partial
from pathlib import Path

import zenoh
from zenoh.handlers import Callback

from yahboomd.client.streams import read_sample
from yahboomd.core.bus import keys
from yahboomd.core.bus.blocking import bounded
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.keys import full_key, holder_key
from yahboomd.core.bus.presence import LONGEST_KEY, TokenChange
from yahboomd.core.clock import Clock
from yahboomd.core.messages.native import ServiceReply, StatusSample
from yahboomd_fleet.fleet_list import FleetList
from yahboomd_fleet.fleet_view import MOST_UNLISTED, FleetView
from yahboomd_fleet.fleet_way import FleetWay

PERIOD_S = 2.0
"""How often the robots are asked."""

ANSWER_S = 5.0
"""A query is given up after this time; later ones have been sent by then."""

GATHER_S = 0.2
"""Answers are read this often."""

MOST_BYTES = 1 << 16
"""The largest answer that is read: a status has some kilobytes."""


class LookWay(FleetWay):
    """A router over which the robots are asked.

    Args:
        first: Whether it is the one that is always asked.
    """

    def __init__(
        self,
        endpoint: str,
        papers: Path | None,
        places: list[str],
        feed: FleetFeed,
        *,
        first: bool,
    ) -> None:
        super().__init__(endpoint, papers, places)
        self._feed = feed
        self._first = first
        self._asked: dict[str, str] = {}

    async def work(self, bus: Bus) -> None:
        """Watch the tokens, and ask again and again."""
        feed = self._feed
        # Those of the list have watches of their own: a flood of others hides none of them.
        for robot in filter(self.leads_to, feed.robots):
            pattern = holder_key(full_key(robot, keys.ALIVE), "*")
            bus.watch_tokens(pattern, partial(feed.tokens_changed, self))
        for pattern in self.wide(holder_key(keys.ALIVE, "*")):
            bus.watch_tokens(pattern, partial(feed.tokens_changed, self))
        loop = asyncio.get_running_loop()
        # First one question for all: it reaches robots that are not in the list, too.
        wanted, due_s = self.wide(keys.STATUS), loop.time()
        while True:
            if loop.time() >= due_s:
                due_s = loop.time() + PERIOD_S
                await self._ask(bus, wanted)
                wanted = self.wide(keys.STATUS)
            await self._ask_configurations(bus)
            await asyncio.sleep(GATHER_S)
            if not self._first:
                waiting = filter(self.leads_to, feed.view.waiting(feed.clock.now_ns()))
                wanted = [full_key(robot, keys.STATUS) for robot in waiting]

    async def _ask_configurations(self, bus: Bus) -> None:
        """Ask each daemon once, if this is the person's right."""
        feed = self._feed
        if not feed.may_read_configuration or not self._first:
            return
        wanted = {
            robot: daemon
            for robot, daemon in feed.view.unconfigured().items()
            if self.leads_to(robot) and self._asked.get(robot) != daemon
        }
        self._asked.update(wanted)
        await self._ask(bus, [full_key(robot, keys.CONFIG) for robot in wanted])

    async def _ask(self, bus: Bus, selectors: list[str]) -> None:
        if not selectors:
            return

        def ask() -> None:
            for selector in selectors:
                bus.session.get(
                    selector,
                    Callback(self._feed.replied, indirect=False),
                    target=zenoh.QueryTarget.ALL,
                    consolidation=zenoh.ConsolidationMode.NONE,
                    timeout=ANSWER_S,
                )

        with suppress(TimeoutError, zenoh.ZError):
            await bounded(ask, timeout_s=ANSWER_S, name="fleet-look")


class FleetFeed:
    """Keeps a view of a fleet up to date.

    Args:
        fleet: The robots, and the ways to them.
        papers: The person's file; None for routers without access rules.
        view: Takes the answers.

    Attributes:
        news: Set when the view may have changed.
        may_read_configuration: Whether versions and calibrations are asked for, too.
    """

    def __init__(
        self, fleet: FleetList, papers: Path | None, view: FleetView, clock: Clock
    ) -> None:
        self.view = view
        self.clock = clock
        self.robots = fleet.robots
        self.may_read_configuration = fleet.role == "maintainer"
        self.news = asyncio.Event()
        self._ways = [
            LookWay(endpoint, papers, places, self, first=number == 0)
            for number, (endpoint, places) in enumerate(fleet.ways.items())
        ]
        self._tokens: dict[str, set[str]] = {}
        self._listed = frozenset(
            full_key(robot, key) for robot in fleet.robots for key in (keys.STATUS, keys.CONFIG)
        )
        self._answers: dict[str, bytes] = {}
        self._most = 2 * (len(fleet.robots) + MOST_UNLISTED)
        self._lock = threading.Lock()
        self._unread = 0

    async def run(self) -> None:
        """Ask until cancelled.

        Raises:
            BusError: The papers cannot be used.
        """
        tasks = [asyncio.create_task(way.run(), name="fleet-look") for way in self._ways]
        try:
            while True:
                for task in tasks:
                    if task.done():
                        task.result()
                await self._read_all()
                await asyncio.sleep(GATHER_S)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    def is_complete(self) -> bool:
        """Whether every robot that may be there has answered all that it is asked."""
        waiting = self.view.waiting(self.clock.now_ns())
        return not waiting and not (self.may_read_configuration and self.view.unconfigured())

    def tokens_changed(self, way: LookWay, changes: list[TokenChange]) -> None:
        """Note tokens as one way shows them."""
        for change in changes:
            robot = change.key.rpartition(f"/{keys.ALIVE}/")[0]
            tokens = self._tokens.setdefault(robot, set())
            (tokens.add if change.present else tokens.discard)(f"{id(way)} {change.key}")
            self.view.token(robot, self.clock.now_ns(), present=bool(tokens))
            if not tokens:
                del self._tokens[robot]
        self.news.set()

    def replied(self, reply: zenoh.Reply) -> None:
        """Keep a robot's answer, in Zenoh's thread."""
        if reply.ok is None:
            return
        key, payload = str(reply.ok.key_expr), reply.ok.payload
        with self._lock:
            # However many others answer, there is room for those of the list.
            room = key in self._listed or key in self._answers or len(self._answers) < self._most
            if room and len(key) <= LONGEST_KEY and len(payload) <= MOST_BYTES:
                self._answers[key] = payload.to_bytes()
            else:
                self._unread += 1

    async def _read_all(self) -> None:
        """Read what came since the last call; whatever else is due comes between two answers."""
        with self._lock:
            answers, self._answers = self._answers, {}
            unread, self._unread = self._unread, 0
        self.view.left_out += unread
        for key, payload in answers.items():
            self._read(key, payload)
            await asyncio.sleep(0)
        if answers or unread:
            self.news.set()

    def _read(self, key: str, payload: bytes) -> None:
        # The fields of samples and replies differ, so one is never read as the other.
        place = key.removesuffix(keys.STATUS)
        if place != key and (status := read_sample(payload, StatusSample)) is not None:
            self.view.answered(place.rstrip("/"), status, self.clock.now_ns())
        elif (reply := read_sample(payload, ServiceReply)) is None:
            self.view.unread()
        elif reply.success:
            self.view.configured(key.removesuffix(keys.CONFIG).rstrip("/"), reply.data)
