"""Follows one robot for the metrics: its status, its events, and its speeds once a second."""

from __future__ import annotations

import asyncio
import math
from collections import Counter
from typing import TypeVar

import msgspec

from yahboomd.client.connection import Connection
from yahboomd.client.services import ask
from yahboomd.client.streams import MAX_BYTES, read_sample
from yahboomd.core.bus import keys
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.options import BusOptions
from yahboomd.core.bus.subscriptions import Arrival
from yahboomd.core.clock import Clock, nanoseconds, seconds
from yahboomd.core.messages.native import (
    EventSample,
    ServiceReply,
    StatusSample,
    TwistSample,
    WheelsSample,
)
from yahboomd.tools.metrics.robot_metrics import RobotFacts
from yahboomd.tools.schemas.event_kinds import KINDS

PERIOD_S = 1.0
ANSWER_S = 0.8

ALIVE_S = 3.0
"""A daemon publishes a status twice a second; without a new one for this time it counts as dead."""

MAX_KINDS = 128
"""Kinds of events that are counted apart; more are counted as ``other``."""

Sample = TypeVar("Sample", bound=msgspec.Struct)


class RobotPoll:
    """Follows one robot, and asks its daemon once a second, independently of :meth:`current`."""

    def __init__(self, name: str, options: BusOptions, clock: Clock) -> None:
        self.name = name
        self._clock = clock
        self._connection = Connection(options, clock)
        self._status: StatusSample | None = None
        self._status_ns: int | None = None
        self._twist: TwistSample | None = None
        self._wheels: WheelsSample | None = None
        # All kinds from the start: a series that begins at 1 hides its first event from increase().
        self._events: Counter[tuple[str, str]] = Counter(
            {(kind, severity): 0 for kind, info in KINDS.items() for severity in info.severities}
        )
        self._unreadable = 0

    async def run(self) -> None:
        """Follow it until cancelled, and wait for a daemon that is not there.

        Raises:
            BusError: It can never be reached like this: a wrong endpoint, namespace or file.
        """
        connection = self._connection
        await connection.open(math.inf)
        try:
            connection.bus.subscribe(keys.STATUS, self._receive_status, max_bytes=MAX_BYTES)
            connection.bus.subscribe(keys.EVENTS, self._count, max_bytes=MAX_BYTES)
            loop = asyncio.get_running_loop()
            due_s = loop.time()
            while True:
                await self._poll(connection.bus)
                # After a pause the schedule starts again: missed polls are not made up for.
                due_s = max(due_s + PERIOD_S, loop.time())
                await asyncio.sleep(due_s - loop.time())
        finally:
            await connection.close()

    def current(self) -> RobotFacts:
        """The robot's facts as known now."""
        age_ns = None if self._status_ns is None else self._clock.now_ns() - self._status_ns
        fresh = age_ns is not None and age_ns < nanoseconds(ALIVE_S)
        return RobotFacts(
            name=self.name,
            # Each alone can deceive: the token of a hung daemon, the status of one that just left.
            status=self._status if fresh and self._connection.alive else None,
            status_age_s=None if age_ns is None else seconds(age_ns),
            twist=self._twist,
            wheels=self._wheels,
            events=dict(self._events),
            unreadable=self._unreadable,
        )

    def _receive_status(self, arrivals: list[Arrival]) -> None:
        status = read_sample(arrivals[-1].payload, StatusSample)
        if status is None:
            self._unreadable += 1
        else:
            self._status, self._status_ns = status, arrivals[-1].arrived_ns

    async def _poll(self, bus: Bus) -> None:
        if not self._connection.alive:
            return
        self._twist, self._wheels = await asyncio.gather(
            self._newest(bus, keys.TWIST, TwistSample),
            self._newest(bus, keys.WHEELS, WheelsSample),
        )

    async def _newest(self, bus: Bus, key: str, message: type[Sample]) -> Sample | None:
        payloads = await ask(bus.session, bus.key(key), timeout_s=ANSWER_S)
        for payload in payloads:
            small = len(payload) <= MAX_BYTES
            if small and (sample := read_sample(payload, message)) is not None:
                return sample
            # Before its first sample a daemon answers with a refusal.
            if not small or read_sample(payload, ServiceReply) is None:
                self._unreadable += 1
        return None

    def _count(self, arrivals: list[Arrival]) -> None:
        for arrival in arrivals:
            event = read_sample(arrival.payload, EventSample)
            if event is None:
                self._unreadable += 1
                continue
            kind = (event.kind, event.severity)
            if kind not in self._events and len(self._events) >= MAX_KINDS:
                kind = ("other", event.severity)
            self._events[kind] += 1
