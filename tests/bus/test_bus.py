import asyncio
import threading

import pytest
from zenoh_fixtures import eventually, free_endpoint

from yahboomd.core.bus import keys
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.options import BusOptions
from yahboomd.core.bus.services import Response
from yahboomd.core.bus.zenoh_sessions import open_uplink
from yahboomd.core.errors import BusError

pytestmark = pytest.mark.usefixtures("fake_zenoh")


def refusal(reason, _request):
    return Response(payload=reason.encode())


async def test_a_bus_that_is_not_open_says_so():
    bus = Bus(BusOptions())
    with pytest.raises(BusError, match="not open"):
        bus.subscribe(keys.CMD_VEL, lambda batch: None)
    with pytest.raises(BusError, match="not open"):
        bus.publisher(keys.POSE)


async def test_what_is_refused_lost_or_failed_on_the_bus_is_counted(bus, app):
    pose = bus.publisher(keys.POSE)
    arrivals = []
    bus.subscribe(keys.CMD_VEL, arrivals.extend, max_bytes=8)
    bus.serve(keys.CONFIG, lambda r: Response(payload=b"here"), fallback=refusal)
    bus.serve(keys.BOARD, lambda r: 1 / 0, fallback=refusal, max_bytes=8)
    pose.put(b"{}")
    app.session.put("bot1/cmd_vel", b"far too large")
    app.session.put("bot1/cmd_vel", b"small")
    await eventually(lambda: arrivals)
    await app.ask("bot1/yahboomd/config")
    await app.ask("bot1/yahboomd/board", payload=b"far too large")
    await app.ask("bot1/yahboomd/board")
    await bus.close()
    pose.put(b"{}")
    found = bus.status_values()
    assert found == {
        "puts": 1,
        "put_errors": 1,
        "samples_dropped": 0,
        "samples_oversize": 1,
        "floods": 0,
        "requests": 2,
        "requests_refused": 1,
        "requests_failed": 1,
        "answers_unsent": 0,
    }


async def test_the_first_router_that_answers_is_joined(fake_zenoh):
    router = fake_zenoh.open_router(free_endpoint())
    session = await open_uplink(BusOptions(connect=(free_endpoint(), *router.listen)))
    assert [link.dst for link in session.info.links()] == router.listen


async def test_a_router_that_is_not_there_is_waited_for_until_cancelled():
    waiting = asyncio.create_task(open_uplink(BusOptions(connect=(free_endpoint(),))))
    await eventually(lambda: not waiting.done())
    waiting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await waiting
    await eventually(
        lambda: not any(thread.name == "bus-uplink" for thread in threading.enumerate())
    )
