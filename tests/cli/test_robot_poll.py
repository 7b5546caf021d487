from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import suppress
from typing import Any

import daemon_samples
import msgspec
import pytest
from zenoh_fixtures import eventually, free_endpoint

from yahboomd.core.bus import keys
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.options import BusOptions
from yahboomd.core.bus.services import BusQuery, Response
from yahboomd.core.clock import SystemClock, nanoseconds
from yahboomd.core.errors import BusError
from yahboomd.core.messages.codecs import encode
from yahboomd.tools.metrics import robot_poll
from yahboomd.tools.metrics.robot_poll import ALIVE_S, RobotPoll

pytestmark = pytest.mark.realtime


class Daemon:
    """Publishes a status, answers for the newest samples, and counts the questions."""

    def __init__(self) -> None:
        self.endpoint = free_endpoint()
        self.bus = Bus(BusOptions(listen=(self.endpoint,), connect=(), namespace="bot1"))
        self.asked: list[str] = []
        self.samples: dict[str, msgspec.Struct | bytes] = {
            keys.TWIST: daemon_samples.twist(),
            keys.WHEELS: daemon_samples.wheels(),
        }

    async def start(self) -> None:
        await self.bus.open()
        for key in self.samples:
            self.bus.serve(key, self._answer, fallback=lambda *_: Response(payload=b""))
        self.bus.token(keys.holder_key(keys.ALIVE, self.bus.zid))
        self.events = self.bus.publisher(keys.EVENTS)
        self.publishing = asyncio.create_task(self._publish())

    async def close(self) -> None:
        self.publishing.cancel()
        with suppress(asyncio.CancelledError):
            await self.publishing
        await self.bus.close()

    async def _publish(self) -> None:
        status = self.bus.publisher(keys.STATUS)
        while True:
            status.put(encode(daemon_samples.status(), "json"))
            await asyncio.sleep(0.05)

    def _answer(self, request: BusQuery) -> Response:
        self.asked.append(request.key)
        sample = self.samples[request.key]
        payload = sample if isinstance(sample, bytes) else encode(sample, "json")
        return Response(payload=payload)


class ShiftedClock(SystemClock):
    """A clock that a test sets ahead."""

    ahead_ns = 0

    def now_ns(self) -> int:
        return super().now_ns() + self.ahead_ns


@pytest.fixture
async def daemon() -> AsyncIterator[Daemon]:
    made = Daemon()
    await made.start()
    yield made
    await made.close()


@pytest.fixture
async def poll(
    daemon: Daemon, monkeypatch: pytest.MonkeyPatch
) -> AsyncIterator[tuple[RobotPoll, ShiftedClock]]:
    monkeypatch.setattr(robot_poll, "PERIOD_S", 0.05)
    clock = ShiftedClock()
    options = BusOptions(mode="client", listen=(), connect=(daemon.endpoint,), namespace="bot1")
    made = RobotPoll("bot1", options, clock)
    task = asyncio.create_task(made.run())
    yield made, clock
    task.cancel()
    with suppress(asyncio.CancelledError):
        await task


async def test_it_knows_the_newest_samples(daemon: Daemon, poll: Any) -> None:
    watched, _ = poll
    await eventually(lambda: watched.current().status and watched.current().wheels)
    await eventually(lambda: watched.current().twist)
    facts = watched.current()
    assert facts.name == "bot1"
    assert facts.status.state == "driving"
    assert 0.0 <= facts.status_age_s < 3.0
    assert facts.twist.vx == 0.3
    assert facts.wheels.names == ("left", "right")
    assert facts.unreadable == 0


async def test_without_a_new_status_the_daemon_counts_as_dead(daemon: Daemon, poll: Any) -> None:
    watched, clock = poll
    await eventually(lambda: watched.current().status)
    daemon.publishing.cancel()
    asked = len(daemon.asked)
    # Its token is there, and it answers still.
    await eventually(lambda: len(daemon.asked) > asked + 4)
    clock.ahead_ns = nanoseconds(ALIVE_S)
    facts = watched.current()
    assert facts.status is None
    assert facts.status_age_s >= ALIVE_S


async def test_a_daemon_that_ended_counts_as_dead_at_once(daemon: Daemon, poll: Any) -> None:
    watched, _ = poll
    await eventually(lambda: watched.current().status)
    await daemon.close()
    await eventually(lambda: watched.current().status is None)
    assert watched.current().status_age_s is not None


@pytest.mark.cases(1)
@pytest.mark.parametrize("payload", [b"{", b"\xff\x00", b"[" * 3000, b'{"success": 3}', b""])
async def test_what_cannot_be_read_is_counted(daemon: Daemon, poll: Any, payload: bytes) -> None:
    watched, _ = poll
    daemon.samples[keys.WHEELS] = payload
    await eventually(lambda: watched.current().unreadable > 1)
    assert watched.current().wheels is None


async def test_events_are_counted_by_kind(daemon: Daemon, poll: Any) -> None:
    watched, _ = poll
    await eventually(lambda: watched.current().status and daemon.events.has_subscribers)
    event = daemon_samples.event()
    for _ in range(3):
        daemon.events.put(encode(event, "json"))
    daemon.events.put(b"nonsense")
    key = (event.kind, event.severity)
    assert watched.current().events[key] == 0
    await eventually(
        lambda: watched.current().events.get(key) == 3 and watched.current().unreadable
    )


async def test_a_place_that_can_never_be_reached_ends_it() -> None:
    options = BusOptions(mode="client", listen=(), connect=("smoke/signals",))
    with pytest.raises(BusError):
        await RobotPoll("bot1", options, SystemClock()).run()
