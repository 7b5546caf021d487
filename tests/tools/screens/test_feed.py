from __future__ import annotations

import asyncio
import signal
from typing import Any

import pytest
from real_robot import Process
from zenoh_fixtures import eventually, free_endpoint

from yahboomd.core.bus.options import BusOptions
from yahboomd.core.clock import SystemClock
from yahboomd.core.errors import BusError
from yahboomd.tools.screens.feed import Feed
from yahboomd.tools.stop.unresponsive import process_state

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


async def test_an_event_is_news(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    async with feed_of(daemon.endpoint) as feed:
        await phase(feed, "live")
        feed.news.clear()
        await eventually(feed.news.is_set)
        await eventually(lambda: daemon.has_listener)
        daemon.tell("It rains.")
        await eventually(feed.dashboard.new_events)


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


async def test_a_router_without_this_robot_is_distinguished_from_no_router(
    fake_daemon: Any,
) -> None:
    daemon = await fake_daemon(namespace="bot1")
    async with feed_of(daemon.endpoint, "bot2") as feed:
        await eventually(lambda: "no yahboomd" in feed.why)
        assert "'bot2'" in feed.why
        assert "`yahboomd run`" not in feed.why


async def test_what_can_never_be_reached_is_raised() -> None:
    async with feed_of("nonsense") as feed:
        await eventually(feed._reaching.done)
        with pytest.raises(BusError, match="nonsense"):
            feed.check()


async def test_a_suspended_daemon_is_named_with_the_command_that_continues_it() -> None:
    endpoint = free_endpoint()
    daemon = Process(
        *("run", "--port", "/dev/not-there", "--set", f'zenoh.listen=["{endpoint}"]'),
        *("--set", "zenoh.connect=[]"),
    )
    try:
        pid = daemon.process.pid
        await asyncio.to_thread(daemon.says, "Listening")
        daemon.process.send_signal(signal.SIGSTOP)
        await eventually(lambda: process_state(pid) == "T")
        async with feed_of(endpoint) as feed:
            await eventually(lambda: feed.why)
            assert feed.why == (
                f"yahboomd (pid {pid}) listens at {endpoint} and is suspended. "
                f"Continue it with `fg` or `kill -CONT {pid}`."
            )
    finally:
        daemon.process.send_signal(signal.SIGCONT)
        await asyncio.to_thread(daemon.end)
