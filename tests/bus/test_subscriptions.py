import asyncio
import itertools

import pytest
import zenoh
from zenoh_fixtures import eventually, free_endpoint

from yahboomd.core.bus import keys
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.options import BusOptions
from yahboomd.core.bus.subscriptions import FLOOD, RING

pytestmark = pytest.mark.usefixtures("fake_zenoh")


@pytest.fixture
def arrivals():
    return []


async def test_a_sample_arrives_with_all_that_is_known_of_it(bus, zenoh_app, arrivals):
    bus.subscribe(keys.CMD_VEL, arrivals.extend)
    app = zenoh_app("client", bus.options.listen[0], {"timestamping/enabled": True})
    before_ns = bus._clock.now_ns()
    sent = app.session.new_timestamp().get_time_as_ntp64().as_nanos()
    app.session.put("bot1/cmd_vel", b'{"vx": 1}', attachment=b"gid")
    (arrival,) = await eventually(lambda: arrivals)
    assert arrival.key == "cmd_vel"
    assert (arrival.payload, arrival.attachment) == (b'{"vx": 1}', b"gid")
    assert arrival.dropped == 0
    assert before_ns <= arrival.arrived_ns <= bus._clock.now_ns()
    assert sent <= arrival.stamp_ns <= sent + 20_000_000_000


async def test_an_old_stamp_arrives_as_it_was_made_and_one_made_on_arrival_is_none(
    bus, zenoh_app, turns, arrivals
):
    """A sender that does not stamp is stamped by us as its sample arrives: that tells nothing."""
    bus.subscribe(keys.CMD_VEL, arrivals.extend)
    session = zenoh_app("client", bus.options.listen[0], {"timestamping/enabled": False}).session
    old = zenoh.Timestamp(zenoh.NTP64(1_700_000_000, 0), bytes(session.new_timestamp().get_id()))
    session.put("bot1/cmd_vel", b"{}", timestamp=old)
    session.put("bot1/cmd_vel", b"{}")
    await turns()
    assert [each.stamp_ns for each in arrivals] == [1_700_000_000_000_000_000, None]


async def test_too_large_a_sample_is_counted_and_not_delivered(bus, app, turns, arrivals):
    subscription = bus.subscribe(keys.CMD_VEL, arrivals.extend, max_bytes=100)
    for size, attachment in ((1_000_000, None), (101, None), (50, b"y" * 51), (50, b"y" * 50)):
        app.session.put("bot1/cmd_vel", b"x" * size, attachment=attachment)
    await turns()
    assert [arrival.attachment for arrival in arrivals] == [b"y" * 50]
    assert (subscription.counters.oversize, subscription.counters.received) == (3, 4)


async def test_where_any_payload_counts_one_that_is_too_large_arrives_empty(
    bus, app, turns, arrivals
):
    """Samples are checked as they arrive, so only small ones wait for the loop."""
    subscription = bus.subscribe(keys.CMD_VEL, arrivals.extend, max_bytes=100, keep_oversize=True)
    for carried in ({"attachment": bytes(1_000_000)}, {"attachment": b"y" * 51}, {}):
        app.session.put("bot1/cmd_vel", b"x" * 50, **carried)
    assert [received[0] for received in subscription._lane._entries] == [None, None, b"x" * 50]
    await turns()
    assert [arrival.oversize for arrival in arrivals] == [True, True, False]
    assert arrivals[0].payload == b""


async def test_a_deletion_arrives_as_an_empty_payload(bus, app, turns, arrivals):
    bus.subscribe(keys.CMD_VEL, arrivals.extend)
    app.session.delete("bot1/cmd_vel")
    await turns()
    assert [arrival.payload for arrival in arrivals] == [b""]


async def test_nothing_arrives_after_the_end(bus, app, turns, arrivals):
    ended = []
    subscription = bus.subscribe(keys.CMD_VEL, ended.extend)
    bus.subscribe(keys.CMD_VEL, arrivals.extend)
    app.session.put("bot1/cmd_vel", b"{}")
    subscription.close()
    app.session.put("bot1/cmd_vel", b"{}")
    await turns()
    assert (len(arrivals), ended) == (2, [])


async def test_what_was_ended_before_a_router_came_stays_ended(fake_zenoh, arrivals):
    place = free_endpoint()
    async with Bus(BusOptions(listen=(free_endpoint(),), connect=(place,))) as bus:
        ended = []
        bus.subscribe(keys.CMD_VEL, ended.extend).close()
        bus.subscribe(keys.CMD_VEL, arrivals.extend)
        router = fake_zenoh.open_router(place)
        await eventually(lambda: bus.neighbours)
        router.put("cmd_vel", b"x")
        await eventually(lambda: arrivals)
        assert ended == []


async def test_the_newest_of_a_flood_is_delivered_and_later_samples_one_by_one_again(
    fake_zenoh, zenoh_app, arrivals, turns
):
    """Through both sessions."""
    place = free_endpoint()
    router = fake_zenoh.open_router(place)
    async with Bus(BusOptions(listen=(free_endpoint(),), connect=(place,))) as bus:
        subscription = bus.subscribe(keys.CMD_VEL, arrivals.extend)
        await eventually(lambda: bus.neighbours)
        apps = [router, zenoh_app("client", bus.options.listen[0]).session]
        for number in range(FLOOD):
            for app in apps:
                app.put("cmd_vel", b"%d" % number)
        await turns()
        assert subscription.flooded
        arrivals.clear()
        for number in range(50):
            for way, app in enumerate(apps):
                app.put("cmd_vel", b"%d/%d" % (way, number))
        await eventually(lambda: not subscription.flooded)
        newest = range(50 - RING, 50)
        assert {each.payload for each in arrivals} == {
            b"%d/%d" % each for each in itertools.product(range(2), newest)
        }
        # A full ring does not count what it lost.
        assert sum(each.dropped for each in arrivals) == 2
        for app in apps:
            app.put("cmd_vel", b"after")
        await turns()
        assert [each.payload for each in arrivals[-2:]] == [b"after"] * 2
        assert (subscription.counters.floods, subscription.flooded) == (1, False)


async def test_in_a_flood_large_samples_are_let_go_at_once(bus, app, arrivals, turns):
    subscription = bus.subscribe("x", arrivals.extend, max_bytes=10, keep_oversize=True)
    for _ in range(FLOOD + 1):
        app.session.put("bot1/x", b"x")
    await turns()
    arrivals.clear()
    app.session.put("bot1/x", b"x" * 20)
    app.session.put("bot1/x", b"x")
    await eventually(lambda: arrivals)
    assert [each.oversize for each in arrivals] == [True, False]
    assert subscription.counters.oversize == 1


async def test_a_backlog_of_a_stalled_link_is_no_flood(bus, app, arrivals, turns):
    subscription = bus.subscribe(keys.CMD_VEL, arrivals.extend, depth=64)
    for number in range(200):
        app.session.put("bot1/cmd_vel", b"%d" % number)
    await turns()
    assert arrivals[-1].payload == b"199"
    assert subscription.counters.floods == 0


async def test_gathered_samples_come_late_all_at_once_with_the_time_of_their_arrival(bus, app):
    batches = []
    subscription = bus.subscribe("x", batches.append, gather_s=0.5)
    # Two turns, so that all come within one.
    loop = asyncio.get_running_loop()
    before = loop.time() // 0.5
    await eventually(lambda: loop.time() // 0.5 > before)
    moments_ns = [bus._clock.now_ns()]
    for number in range(3):
        app.session.put("bot1/x", str(number))
        moments_ns.append(bus._clock.now_ns())
    await eventually(lambda: batches)
    (batch,) = batches
    assert [arrival.payload for arrival in batch] == [b"0", b"1", b"2"]
    near_ns = 100_000_000
    for arrival, (before_ns, after_ns) in zip(batch, itertools.pairwise(moments_ns), strict=True):
        assert before_ns - near_ns < arrival.arrived_ns < after_ns + near_ns
    assert subscription.counters.dropped == 0


async def test_more_than_is_gathered_counts_as_a_loss(bus, app):
    batches = []
    bus.subscribe("x", batches.append, gather_s=0.2, depth=2)
    for number in range(5):
        app.session.put("bot1/x", str(number))
    await eventually(lambda: batches)
    assert sum(len(batch) for batch in batches) < 5
    assert batches[0][0].dropped == 1
