import asyncio
import threading

import pytest
from zenoh_fixtures import eventually, free_endpoint

from yahboomd.bus import keys
from yahboomd.bus.options import BusOptions
from yahboomd.bus.session import Bus
from yahboomd.bus.uplink import open_uplink

pytestmark = pytest.mark.realtime


async def test_a_router_that_is_there_is_joined(zenoh_router):
    zenoh_router.start()
    session = await open_uplink(BusOptions(connect=(zenoh_router.endpoint,)))
    try:
        await eventually(session.info.routers_zid)
    finally:
        session.close()


async def test_the_first_router_that_answers_is_joined(zenoh_router):
    zenoh_router.start()
    session = await open_uplink(BusOptions(connect=(free_endpoint(), zenoh_router.endpoint)))
    try:
        (link,) = await eventually(session.info.links)
        assert link.dst == zenoh_router.endpoint
    finally:
        session.close()


async def test_a_router_that_is_not_there_is_waited_for_until_cancelled():
    waiting = asyncio.create_task(open_uplink(BusOptions(connect=(free_endpoint(),))))
    await eventually(lambda: not waiting.done())
    waiting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await waiting
    await eventually(
        lambda: not any(thread.name == "bus-uplink" for thread in threading.enumerate())
    )


async def test_what_was_put_before_a_router_came_reaches_who_looks_later(zenoh_router, zenoh_app):
    options = BusOptions(listen=(free_endpoint(),), connect=(zenoh_router.endpoint,))
    async with Bus(options) as bus:
        bus.publisher(keys.ROS_TF_STATIC, cache=1).put(b"static frames")
        zenoh_router.start()
        await eventually(lambda: bus.neighbours)
        app = zenoh_app("client", zenoh_router.endpoint)
        late = app.late_subscriber("tf_static")
        assert (await eventually(late.try_recv)).payload == b"static frames"


async def test_what_was_ended_before_a_router_came_stays_ended(zenoh_router, zenoh_app):
    options = BusOptions(listen=(free_endpoint(),), connect=(zenoh_router.endpoint,))
    async with Bus(options) as bus:
        ended, kept = [], []
        bus.subscribe(keys.CMD_VEL, ended.extend).close()
        bus.token(keys.ALIVE).close()
        bus.publisher(keys.POSE).close()
        bus.subscribe(keys.CMD_VEL, kept.extend)
        zenoh_router.start()
        await eventually(lambda: bus.neighbours)
        app = zenoh_app("client", zenoh_router.endpoint)
        await app.reach("cmd_vel")
        app.session.put("cmd_vel", b"x")
        await eventually(lambda: kept)
        assert ended == []
        assert list(app.session.liveliness().get("yahboomd/alive")) == []
