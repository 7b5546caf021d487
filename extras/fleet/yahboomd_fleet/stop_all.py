"""Stops every robot of a fleet, over every router that leads to it, until each acknowledged.

The stop goes out as a sample on the key of each group, for every robot there, known or not; and as
a query, which each robot answers on its own key. First goes a query by the person's own key, so
that each robot records who stopped it. The routers' rules let a robot's certificate
answer on no other key, so that nobody acknowledges for another robot.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TypeAlias

import msgspec
import zenoh
from zenoh.handlers import Callback

from yahboomd.client.streams import read_sample
from yahboomd.core.bus import keys
from yahboomd.core.bus.blocking import bounded
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.keys import full_key, holder_key, own_key
from yahboomd.core.bus.presence import TokenChange
from yahboomd.core.clock import Clock, seconds, timeout
from yahboomd.core.messages.native import ServiceReply, WheelsSample
from yahboomd_fleet.fleet_list import FleetList
from yahboomd_fleet.fleet_plan import stop_key
from yahboomd_fleet.fleet_stop import FleetStop
from yahboomd_fleet.fleet_way import FleetWay

AGAIN_S = 0.5
"""Missing robots are asked again this often."""

ANSWER_S = 5.0
"""A query is given up after this time; later ones have been sent by then."""

TELL_S = 2.0
"""How often missing robots are named."""

SendTo: TypeAlias = tuple[Sequence[str], Sequence[str], Sequence[str]]
"""Selectors that prove a name, keys of groups, and selectors."""

_LONGEST_NAME = 24
_OWN = "yahboomd"


class StopWay(FleetWay):
    """A router over which the stop goes."""

    def __init__(self, endpoint: str, papers: Path, places: list[str], stop: StopAll) -> None:
        super().__init__(endpoint, papers, places)
        self._stop = stop
        self.wake = asyncio.Event()
        """Set to send at once to the robots that are wanted."""

    async def work(self, bus: Bus) -> None:
        """Send at once, and again while robots are missing."""
        mine = list(filter(self.leads_to, self._stop.progress.robots))
        # First one question for all: it reaches robots that are not in the list, too.
        own = self.wide(own_key(keys.ESTOP, self._stop.person))
        await self._send(bus, self.wide(keys.ESTOP), own)
        for robot in mine:
            pattern = holder_key(full_key(robot, keys.ALIVE), "*")
            bus.watch_tokens(pattern, partial(self._stop.seen, self, robot))
        while True:
            self.wake.clear()
            with suppress(TimeoutError):
                async with timeout(AGAIN_S):
                    await self.wake.wait()
            if wanted := list(filter(self.leads_to, self._stop.progress.missing)):
                await self._send(bus, [stop_key(each) for each in wanted])
            if turning := list(filter(self.leads_to, self._stop.turning)):
                await self._ask_speeds(bus, turning)

    async def _send(self, bus: Bus, selectors: list[str], first: Sequence[str] = ()) -> None:
        groups = [stop_key(place) for place in self.places if place.count("/") < 2]
        call = partial(_send, bus.session, (first, groups, selectors), self._stop)
        # A connection that takes nothing is closed by Zenoh after a second.
        with suppress(TimeoutError, zenoh.ZError):
            await bounded(call, timeout_s=ANSWER_S, name="fleet-stop")

    async def _ask_speeds(self, bus: Bus, robots: list[str]) -> None:
        def ask() -> None:
            for robot in robots:
                key = full_key(robot, keys.WHEELS)
                replied = Callback(self._stop.replied, indirect=False)
                bus.session.get(key, replied, timeout=ANSWER_S)

        with suppress(TimeoutError, zenoh.ZError):
            await bounded(ask, timeout_s=ANSWER_S, name="fleet-speeds")


class StopAll:
    """Sends a stop until every known robot acknowledged it.

    Args:
        fleet: The robots, and the ways to them.
        papers: The person's file.
        progress: Collects the answers; it can be read after an interrupt, too.
        tell: Takes a line of progress for a person.
    """

    def __init__(
        self,
        fleet: FleetList,
        papers: Path,
        progress: FleetStop,
        tell: Callable[[str], None],
        clock: Clock,
    ) -> None:
        self.progress = progress
        self.person = fleet.person
        self.payload = msgspec.json.encode(
            {"by": f"{fleet.person[:_LONGEST_NAME]}, yahboomd fleet stop"}
        )
        self._fleet = fleet
        self._papers = papers
        self._tell = tell
        self._clock = clock
        self._began_ns = clock.now_ns()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._news = asyncio.Event()
        self._tokens: dict[str, set[str]] = {}
        self._ways: list[StopWay] = []
        self._over = False

    @property
    def turning(self) -> list[str]:
        """The robots whose wheels may still come to rest."""
        return self.progress.turning(self._now_s())

    async def run(self) -> None:
        """Stop them; returns when all acknowledged, and stand or had three seconds for it.

        Raises:
            BusError: The papers cannot be used.
        """
        self._loop = asyncio.get_running_loop()
        self._ways = [
            StopWay(endpoint, self._papers, places, self)
            for endpoint, places in self._fleet.ways.items()
        ]
        tasks = [asyncio.create_task(way.run(), name="fleet-way") for way in self._ways]
        told_s, told = 0.0, ""
        try:
            while not self.progress.is_over(now_s := self._now_s()):
                for task in tasks:
                    if task.done():
                        task.result()
                if now_s - told_s >= TELL_S and told != (words := self.progress.progress()):
                    told_s, told = now_s, words
                    self._tell(words)
                self._news.clear()
                with suppress(TimeoutError):
                    async with timeout(AGAIN_S):
                        await self._news.wait()
        finally:
            # As the connections close, every token goes: that tells nothing of the robots.
            self._over = True
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    def again(self) -> None:
        """Have every robot acknowledge anew, while it runs."""
        self.progress.again()
        for way in self._ways:
            way.wake.set()

    def seen(self, way: StopWay, robot: str, changes: list[TokenChange]) -> None:
        """Note tokens of a robot, as one way shows them; once it has ended they change nothing."""
        if self._over:
            return
        tokens = self._tokens.setdefault(robot, set())
        for change in changes:
            (tokens.add if change.present else tokens.discard)(f"{id(way)} {change.key}")
        if self.progress.seen(robot, present=bool(tokens)):
            for each in self._ways:
                each.wake.set()
        self._news.set()

    def replied(self, reply: zenoh.Reply) -> None:
        """Take a robot's answer, in Zenoh's thread."""
        if self._loop is None or reply.ok is None:
            return
        key, payload = str(reply.ok.key_expr), reply.ok.payload.to_bytes()
        with suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(self._answered, key, payload)

    def _answered(self, key: str, payload: bytes) -> None:
        robot, _, what = key.rpartition(f"/{_OWN}/")
        answer, wheels = read_sample(payload, ServiceReply), read_sample(payload, WheelsSample)
        if f"{_OWN}/{what}" == keys.ESTOP and answer is not None:
            self.progress.answered(robot, answer, self._now_s())
        elif robot in self.progress.robots and wheels is not None:
            self.progress.measured(robot, wheels.seq, wheels.speed_m_s)
        self._news.set()

    def _now_s(self) -> float:
        return seconds(self._clock.now_ns() - self._began_ns)


def _send(session: zenoh.Session, keys_of: SendTo, stop: StopAll) -> None:
    """Send the stop: as queries that prove a name, as samples to groups, and as queries."""
    first, groups, selectors = keys_of
    # A name that makes no key must not keep the robots driving.
    with suppress(zenoh.ZError):
        _ask(session, first, stop)
    for key in groups:
        session.put(
            key,
            stop.payload,
            priority=zenoh.Priority.REAL_TIME,
            congestion_control=zenoh.CongestionControl.BLOCK,
            express=True,
        )
    _ask(session, selectors, stop)


def _ask(session: zenoh.Session, selectors: Sequence[str], stop: StopAll) -> None:
    for selector in selectors:
        session.get(
            selector,
            Callback(stop.replied, indirect=False),
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=ANSWER_S,
            priority=zenoh.Priority.REAL_TIME,
            congestion_control=zenoh.CongestionControl.BLOCK,
            express=True,
            payload=stop.payload,
            encoding="application/json",
        )
