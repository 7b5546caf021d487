"""A topic that somebody reads and the bridge does not send is named, and no other."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest
import zenoh
from zenoh_fixtures import ZenohApp, eventually

from yahboomd.core.bus.bus import Bus
from yahboomd.ros2.ros2_routes import RouteWatch

pytestmark = pytest.mark.realtime


@pytest.fixture
def asked(bus: Bus) -> Callable[[], str]:
    """A watch of three topics; each call is a round."""
    watch = RouteWatch(bus, lambda _part, callback: callback)
    watch.watch("odom")
    watch.watch("estopped")
    watch.watch("battery_state")
    return watch.ask


def route(name: str, *, active: bool) -> tuple[str, bytes]:
    facts = {"ros2_name": f"/{name}", "is_active": active, "local_nodes": []}
    return f"route/topic/sub/{name}", json.dumps(facts).encode()


def reader(name: str) -> tuple[str, bytes]:
    return f"dds/p/reader/7/rt/{name}", b"{}"


def bridge(app: ZenohApp, zid: str, *entries: tuple[str, bytes]) -> zenoh.Queryable[None]:
    """A bridge's admin space."""

    def answer(query: zenoh.Query) -> None:
        for key, payload in entries:
            if query.key_expr.intersects(zenoh.KeyExpr(f"@/{zid}/ros2/{key}")):
                query.reply(f"@/{zid}/ros2/{key}", payload)

    return app.session.declare_queryable(f"@/{zid}/ros2/**", answer)


@pytest.mark.parametrize("below", ["bot1/", ""], ids=["no namespace", "its own namespace"])
async def test_a_reader_without_a_route_is_named_until_it_has_one(
    asked: Callable[[], str], app: ZenohApp, below: str
) -> None:
    odom = f"{below}odom"
    broken = [(f"route/topic/sub/{n}", it) for n, it in enumerate((b"{}", b"no", b"[" * 3000))]
    forgot = bridge(app, "aa", *broken, route(odom, active=False), reader(odom))
    warning = await eventually(asked)
    assert f"The bridge does not send /{odom} to a node" in warning
    forgot.undeclare()
    _knows = bridge(app, "aa", route(odom, active=True), reader(odom))
    await eventually(lambda: not asked())


async def test_what_nobody_reads_or_another_bridge_sends_or_is_not_ours_is_not_named(
    asked: Callable[[], str], app: ZenohApp
) -> None:
    named = reader("odom"), route("odom", active=False)
    unread = route("battery_state", active=False)
    sent_by_another = reader("estopped"), route("estopped", active=False)
    foreign = reader("scan"), route("scan", active=False)
    _one = bridge(app, "aa", *named, unread, *sent_by_another, *foreign)
    _other = bridge(app, "bb", route("estopped", active=True))
    assert (await eventually(asked)).startswith("The bridge does not send /odom to a node")
