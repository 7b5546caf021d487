from __future__ import annotations

from typing import Any

import pytest
from zenoh_fixtures import eventually, free_endpoint

from yahboomd.core.bus.options import BusOptions
from yahboomd.core.clock import SystemClock
from yahboomd.tools.screens.feed import Feed

pytestmark = pytest.mark.realtime


def feed_of(endpoint: str, namespace: str = "") -> Feed:
    options = BusOptions(mode="client", listen=(), connect=(endpoint,), namespace=namespace)
    return Feed(options, SystemClock())


async def phase(feed: Feed, wanted: str) -> None:
    clock = SystemClock()
    await eventually(lambda: feed.view(clock.now_ns()).phase == wanted)


async def test_a_dashboard_fills_from_a_daemon(fake_daemon: Any) -> None:
    daemon = await fake_daemon(namespace="bot1")
    clock = SystemClock()
    async with feed_of(daemon.endpoint, "bot1") as feed:
        await eventually(lambda: feed.view(clock.now_ns()).wheels)
        await eventually(lambda: feed.view(clock.now_ns()).pose)
        await eventually(lambda: feed.view(clock.now_ns()).volts == 7.4)
        await phase(feed, "live")
        assert feed.robot == f"bot1 at {daemon.endpoint}"


async def test_a_daemon_that_goes_and_comes_is_noticed_both_times(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    async with feed_of(daemon.endpoint) as feed:
        await phase(feed, "live")
        await daemon.stop()
        await eventually(lambda: not feed.client.bus.neighbours)
        # At the moment of the latest status: before the daemon could be missed for its silence.
        assert feed.view(0).phase == "silent"
        await eventually(lambda: "is lost" in feed.why)
        await daemon.start()
        await phase(feed, "live")


async def test_a_missing_subscriber_is_reported() -> None:
    endpoint = free_endpoint()
    async with feed_of(endpoint) as feed:
        await eventually(lambda: feed.why)
        assert f"No yahboomd answers at {endpoint}." in feed.why
        assert feed.why.endswith("`yahboomd run` starts a daemon.")
        assert feed.robot == f"yahboomd at {endpoint}"
        feed.check()
