"""The daemon's presence on a real bus, and its reports of others."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from typing import Any

import pytest
from zenoh_fixtures import eventually, free_endpoint

from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.options import BusOptions
from yahboomd.core.bus.presence import TokenChange
from yahboomd.core.daemon.bus_presence import BusPresence
from yahboomd.core.model import Event

pytestmark = pytest.mark.realtime


class Announced:
    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.events: list[Event] = []
        self.losses: list[str] = []
        self.changes: list[str] = []
        self.presence = BusPresence(
            bus,
            report=self.events.append,
            bus_lost=lambda: self.losses.append("lost"),
            changed=lambda: self.changes.append("changed"),
        )
        self.presence.announce()

    def kinds(self) -> list[str]:
        return [event.kind for event in self.events]


@pytest.fixture
async def announced(caplog: pytest.LogCaptureFixture) -> AsyncIterator[Announced]:
    caplog.set_level("INFO", logger="yahboomd")
    async with Bus(BusOptions(listen=(free_endpoint(),), connect=(), namespace="bot1")) as bus:
        yield Announced(bus)


async def test_the_log_says_where_it_listens_and_for_whom(
    announced: Announced, caplog: pytest.LogCaptureFixture
) -> None:
    (endpoint,) = announced.bus.options.listen
    words = [record.getMessage() for record in caplog.get_records("setup")]
    assert f"Listening on {endpoint}, for this machine alone." in words


async def test_a_second_daemon_in_the_namespace_is_an_event_each_time_that_it_comes(
    announced: Announced, zenoh_app: Callable[..., Any]
) -> None:
    app = zenoh_app("client", announced.bus.options.listen[0])
    for times in (1, 2):
        token = app.session.liveliness().declare_token("bot1/yahboomd/alive/abc")
        await eventually(lambda times=times: announced.kinds() == ["second_daemon"] * times)
        token.undeclare()
        await eventually(lambda: not announced.presence._others)


async def test_a_daemon_that_comes_while_the_bus_is_closed_is_no_error() -> None:
    options = BusOptions(listen=(free_endpoint(),), connect=(), namespace="bot1")
    async with Bus(options) as bus:
        announced = Announced(bus)
    announced.presence._holders([TokenChange(key="bot1/yahboomd/alive/abc", present=True)])
    assert announced.kinds() == ["second_daemon"]


async def test_a_client_that_leaves_as_the_last_one_is_a_loss(
    announced: Announced, zenoh_app: Callable[..., Any]
) -> None:
    app = zenoh_app("client", announced.bus.options.listen[0])
    await eventually(lambda: announced.changes)
    assert announced.losses == []
    app.session.close()
    await eventually(lambda: announced.losses)
    assert announced.kinds() == []
