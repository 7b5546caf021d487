from __future__ import annotations

import asyncio
import math
from typing import Any

import daemon_samples
import pytest
from zenoh_fixtures import PATIENCE_S, eventually, free_endpoint

from yahboomd.client.connection import Connection, client_options
from yahboomd.core.bus import keys
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.options import BusOptions
from yahboomd.core.clock import SystemClock
from yahboomd.core.errors import BusConfigError, BusError, NoDaemon
from yahboomd.core.messages.codecs import encode

pytestmark = pytest.mark.usefixtures("fake_zenoh")


def connection(endpoint: str, namespace: str = "", changes: list[bool] | None = None) -> Connection:
    heard = [] if changes is None else changes
    return Connection(client_options(endpoint, namespace=namespace), SystemClock(), heard.append)


async def test_a_daemon_that_goes_and_comes_is_noticed_both_times(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    changes: list[bool] = []
    us = connection(daemon.endpoint, changes=changes)
    await us.open(PATIENCE_S)
    await us.wait_alive(PATIENCE_S)
    await eventually(lambda: us.status)
    await daemon.stop()
    await eventually(lambda: not us.alive)
    assert us.status is None
    await eventually(lambda: "is lost; it reconnects by itself" in us.problem)
    await daemon.start()
    await us.wait_alive(PATIENCE_S)
    assert us.problem == ""
    await us.close()
    assert changes == [True, False, True]


async def test_a_daemon_that_another_one_replaced_was_lost_all_the_same(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    changes: list[bool] = []
    us = connection(daemon.endpoint, changes=changes)
    await us.open(PATIENCE_S)
    await us.wait_alive(PATIENCE_S)
    async with Bus(client_options(daemon.endpoint)) as before:
        before.token(keys.holder_key(keys.ALIVE, before.zid))
        await eventually(lambda: len(us._tokens) == 2)
    await eventually(lambda: len(changes) == 3)
    assert us.alive
    await us.close()
    assert changes == [True, False, True]


async def test_without_a_token_the_status_shows_a_daemon() -> None:
    endpoint = free_endpoint()
    async with Bus(BusOptions(listen=(endpoint,), connect=())) as other:
        us = connection(endpoint)
        await us.open(PATIENCE_S)
        assert not us.alive
        status = other.publisher(keys.STATUS)
        payload = encode(daemon_samples.status(), "json")
        await eventually(lambda: status.put(payload) and us.alive)
        await us.close()


async def test_where_nothing_listens_the_error_says_what_to_start() -> None:
    endpoint = free_endpoint()
    us = connection(endpoint)
    with pytest.raises(NoDaemon, match=f"No yahboomd answers at {endpoint}") as caught:
        await us.open(0.0)
    assert "`yahboomd run`" in caught.value.remedy
    assert "other machines" not in caught.value.remedy
    assert caught.value.__suppress_context__


def test_for_another_machine_the_error_also_names_what_its_daemon_listens_on() -> None:
    remedy = connection("tcp/192.0.2.1:7448").no_daemon().remedy
    assert "`yahboomd run`" in remedy
    assert "zenoh.listen" in remedy


async def test_a_daemon_in_another_namespace_is_named(fake_daemon: Any) -> None:
    daemon = await fake_daemon(namespace="bot1")
    us = connection(daemon.endpoint, namespace="bot2")
    await us.open(PATIENCE_S)
    with pytest.raises(NoDaemon, match="no yahboomd is there in the namespace 'bot2'") as caught:
        await us.wait_alive(0.2)
    assert "'bot1'" in caught.value.remedy
    await us.close()


async def test_a_daemon_that_comes_later_is_reached(fake_daemon: Any) -> None:
    endpoint = free_endpoint()
    us = connection(endpoint)
    opening = asyncio.create_task(us.open(math.inf))
    # On a busy machine a first session may not open in time, which is named before.
    await eventually(lambda: endpoint in us.problem)
    await fake_daemon(endpoint=endpoint)
    await opening
    await us.wait_alive(PATIENCE_S)
    await us.close()


async def test_an_endpoint_that_can_never_work_is_not_waited_for() -> None:
    with pytest.raises(BusError, match="cannot be used"):
        await connection("nonsense").open(math.inf)


async def test_a_file_that_no_network_can_mend_is_not_waited_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def refuse(_: Bus) -> None:
        raise BusConfigError("zenoh.json5 cannot be used.")

    monkeypatch.setattr(Bus, "open", refuse)
    with pytest.raises(BusError, match=r"zenoh\.json5") as caught:
        await asyncio.wait_for(connection(free_endpoint()).open(math.inf), PATIENCE_S)
    assert caught.value.exit_code == 78
