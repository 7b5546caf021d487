"""A process on a real bus that looks like a daemon to a client, and records received samples.

Import the fixture by name in a conftest.py to have it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from contextlib import suppress
from typing import Any, Self

import daemon_samples
import msgspec
import pytest
from zenoh_fixtures import PATIENCE_S, free_endpoint

from yahboomd.client.move_messages import SOURCE
from yahboomd.core.bus import keys
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.options import BusOptions
from yahboomd.core.bus.publishers import BusPublisher
from yahboomd.core.bus.services import BusQuery, Response
from yahboomd.core.bus.subscriptions import Arrival
from yahboomd.core.messages.codecs import encode
from yahboomd.core.messages.native import ServiceReply, StatusSample

PATIENT: dict[str, Any] = {"command": {"timeout_s": 60.0}}
"""A daemon that waits for its sources: a busy machine makes its clients pause."""


class FakeDaemon:
    """A router that publishes samples ten times a second and answers the e-stop's services.

    Args:
        endpoint: Its endpoint.
        namespace: Its robot's name.
        config: Its answer for its configuration; None for no answer.

    Attributes:
        payloads: Published instead of its own samples, by key.
    """

    def __init__(
        self, endpoint: str, namespace: str = "", config: dict[str, Any] | None = None
    ) -> None:
        self.endpoint = endpoint
        self.namespace = namespace
        self.status: StatusSample = daemon_samples.status("standing", driver=None, why="At rest.")
        self.commands: list[dict[str, object]] = []
        self.asked: list[str] = []
        self.releases = True
        self.config = config
        self.payloads: dict[str, bytes] = {}
        self._bus: Bus | None = None
        self._events: BusPublisher | None = None
        self._task: asyncio.Task[None] | None = None
        self._seq = 0

    async def start(self) -> Self:
        """Start, or restart."""
        options = BusOptions(
            listen=(self.endpoint,), connect=(), namespace=self.namespace, lease_s=PATIENCE_S
        )
        self._bus = Bus(options)
        await self._bus.open()
        for key in (keys.CMD_VEL, keys.CMD_VEL_TELEOP, keys.CMD_VEL_WEB, SOURCE):
            self._bus.subscribe(key, self._take)
        if self.config is not None:
            self._bus.serve(keys.CONFIG, self._tell_config, fallback=_refuse)
        self._bus.token(keys.ALIVE)
        self._bus.token(keys.holder_key(keys.ALIVE, self._bus.zid))
        self._bus.serve(keys.STATUS, self._tell_status, fallback=_refuse, wildcards=True)
        self._bus.serve(keys.ESTOP, self._estop, fallback=_refuse)
        self._bus.serve(keys.ESTOP_RESET, self._reset, fallback=_refuse)
        self._events = self._bus.publisher(keys.EVENTS)
        self._task = asyncio.create_task(self._publish(self._bus))
        return self

    def know(self, person: str) -> None:
        """Have a person's own keys, as a robot of a fleet does."""
        assert self._bus is not None
        self._bus.subscribe(f"{keys.CMD_VEL}/{person}", self._take)
        self._bus.serve(keys.own_key(keys.ESTOP_RESET, person), self._reset, fallback=_refuse)
        self._bus.serve(keys.own_key(keys.ESTOP, person), self._estop, fallback=_refuse)

    async def stop(self) -> None:
        """End as a daemon that is stopped; nothing to do when it has."""
        if self._task is not None and self._bus is not None:
            self._task.cancel()
            with suppress(asyncio.CancelledError):
                await self._task
            await self._bus.close()
        self._task = self._bus = self._events = None

    @property
    def has_listener(self) -> bool:
        """Whether a client subscribes to its events: one that comes later misses them."""
        return self._events is not None and self._events.has_subscribers

    def tell(self, message: str) -> None:
        """An event."""
        assert self._events is not None
        self._events.put(encode(daemon_samples.event(message), "json"))

    @property
    def velocities(self) -> list[tuple[object, object]]:
        """The commands, as (vx, wz)."""
        return [(command["vx"], command["wz"]) for command in self.commands]

    async def _publish(self, bus: Bus) -> None:
        publishers = {key: bus.publisher(key) for key in daemon_samples.all_samples()}
        while True:
            self._seq += 1
            samples = {
                **daemon_samples.all_samples(),
                keys.STATUS: encode(self.status, "json"),
                keys.POSE: encode(daemon_samples.pose(seq=self._seq), "json"),
            }
            samples.update(self.payloads)
            if keys.EVENTS not in self.payloads:
                del samples[keys.EVENTS]
            for key, payload in samples.items():
                publishers[key].put(payload)
            await asyncio.sleep(0.1)

    def _take(self, arrivals: list[Arrival]) -> None:
        self.commands += [msgspec.json.decode(arrival.payload) for arrival in arrivals]

    def _tell_status(self, _request: BusQuery) -> Response:
        return Response(payload=self.payloads.get(keys.STATUS) or encode(self.status, "json"))

    def _tell_config(self, _request: BusQuery) -> Response:
        return _answer(True, "The configuration in effect.", self.config)

    def _estop(self, request: BusQuery) -> Response:
        self.asked.append(request.key)
        by = "" if request.key == keys.ESTOP else " by name"
        return _answer(True, f"The emergency stop is engaged{by}.")

    def _reset(self, request: BusQuery) -> Response:
        self.asked.append(request.key)
        words = "Released." if self.releases else "Not released: cmd_vel commands motion."
        return _answer(self.releases, words)


def _answer(success: bool, message: str, data: dict[str, Any] | None = None) -> Response:
    reply = ServiceReply(success=success, message=message, data=data or {})
    return Response(payload=encode(reply, "json"))


def _refuse(*_: object) -> Response:
    return _answer(False, "Refused.")


@pytest.fixture
async def fake_daemon() -> Iterator[Callable[..., Awaitable[FakeDaemon]]]:
    """Starts daemons: ``await fake_daemon(endpoint=..., namespace=...)``."""
    daemons: list[FakeDaemon] = []

    async def start(endpoint: str = "", namespace: str = "", config: Any = PATIENT) -> FakeDaemon:
        daemons.append(FakeDaemon(endpoint or free_endpoint(), namespace, config))
        return await daemons[-1].start()

    yield start
    for each in daemons:
        await each.stop()
