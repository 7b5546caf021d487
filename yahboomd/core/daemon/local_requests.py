"""Emergency stops that the guard was asked for on this machine: engages, and answers.

The guard listens (:mod:`yahboomd.core.link.port_guard`), and sends the stop itself if this process
does not obey in time.
"""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any

import msgspec

from yahboomd.core.clock import Clock, nanoseconds, sleep_until
from yahboomd.core.daemon.control import Controller
from yahboomd.core.daemon.requests import Operator
from yahboomd.core.drive import standing
from yahboomd.core.link.port_guard import PortGuard

STAND_WITHIN_S = 2.0
LOOK_S = 0.01


class LocalRequests:
    """Obeys the requests at the guard's socket."""

    def __init__(
        self, guard: PortGuard, clock: Clock, *, operator: Operator, controller: Controller
    ) -> None:
        self._guard = guard
        self._clock = clock
        self._operator = operator
        self._controller = controller
        self._asked = self._answered = 0
        self._words = ""
        self._tasks: set[asyncio.Task[None]] = set()
        self._watching = False

    def engage(self, number: int, by: str) -> None:
        """Engage the emergency stop before anything else; answers follow."""
        self._words = self._operator.engage_estop(by)
        self._guard.obey(number)
        answering = self._asked > self._answered
        self._asked = number
        if not answering:
            self._start(self._answer())

    def close(self) -> None:
        for task in self._tasks:
            task.cancel()

    def status_values(self) -> dict[str, object]:
        """For the status: the path of the socket, and counts of connections."""
        stops, refused, dropped = self._guard.stop_counts
        return {
            "local_socket": self._guard.socket or "",
            "local_stops": stops,
            "local_refused": refused,
            "local_dropped": dropped,
        }

    async def _answer(self) -> None:
        while self._asked > self._answered:
            number = self._asked
            reply = await self._operator.acknowledged(self._words)
            line = {"engaged": True, "sent": reply.success, "message": reply.message}
            self._guard.answer(number, msgspec.json.encode(line))
            self._answered = number
            if not self._watching:
                self._watching = True
                self._start(self._watch())

    async def _watch(self) -> None:
        clock, controller = self._clock, self._controller
        until_ns = clock.now_ns() + nanoseconds(STAND_WITHIN_S)
        while not controller.wheels_seen()[0] and clock.now_ns() < until_ns:
            await sleep_until(clock, clock.now_ns() + nanoseconds(LOOK_S))
        self._watching = False
        stood, fastest_m_s = controller.wheels_seen()
        why = standing.why(controller.state()[1])
        line = {"stood": stood, "fastest_m_s": fastest_m_s, "why": why}
        self._guard.tell_seen(self._answered, msgspec.json.encode(line))

    def _start(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
