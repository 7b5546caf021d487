import asyncio
import itertools
import threading

import pytest
import zenoh
from zenoh_fixtures import eventually, free_endpoint

from yahboomd.core.bus import keys
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.inbox import Inbox
from yahboomd.core.bus.options import BusOptions
from yahboomd.core.bus.subscriptions import FLOOD, RING, Subscription

pytestmark = pytest.mark.realtime


async def test_a_sample_arrives_with_all_that_is_known_of_it(bus, zenoh_app):
    arrivals = []
    bus.subscribe(keys.CMD_VEL, arrivals.extend)
    app = zenoh_app("client", bus.options.listen[0], {"timestamping/enabled": True})
    before_ns = bus._clock.now_ns()
    sent = app.session.new_timestamp().get_time_as_ntp64().as_nanos()
    app.session.put("bot1/cmd_vel", b'{"vx": 1}', encoding="application/json", attachment=b"gid")
    (arrival,) = await eventually(lambda: arrivals)
    assert arrival.key == "cmd_vel"
    assert arrival.payload == b'{"vx": 1}'
    assert arrival.attachment == b"gid"
    assert arrival.dropped == 0
    assert before_ns <= arrival.arrived_ns <= bus._clock.now_ns()
    assert sent <= arrival.stamp_ns <= sent + 20_000_000_000


async def test_a_stamp_made_on_arrival_is_none(bus, zenoh_app):
    """A sender that does not stamp is stamped by us as its sample arrives: that tells nothing."""
    arrivals = []
    bus.subscribe(keys.CMD_VEL, arrivals.extend)
    app = zenoh_app("client", bus.options.listen[0], {"timestamping/enabled": False})
    app.session.put("bot1/cmd_vel", b"{}")
    (arrival,) = await eventually(lambda: arrivals)
    assert arrival.stamp_ns is None


async def test_a_stamp_made_by_the_router_on_the_way_is_none(zenoh_router, zenoh_app):
    zenoh_router.start()
    arrivals = []
    options = BusOptions(listen=(free_endpoint(),), connect=(zenoh_router.endpoint,))
    async with Bus(options) as bus:
        bus.subscribe(keys.CMD_VEL, arrivals.extend)
        await eventually(lambda: bus.neighbours)
        silent = zenoh_app("client", zenoh_router.endpoint, {"timestamping/enabled": False})
        await silent.reach("cmd_vel")
        silent.session.put("cmd_vel", b"unstamped")
        stamping = zenoh_app("client", zenoh_router.endpoint, {"timestamping/enabled": True})
        await stamping.reach("cmd_vel")
        stamping.session.put("cmd_vel", b"stamped")
        await eventually(lambda: len(arrivals) == 2)
        stamps = {arrival.payload: arrival.stamp_ns for arrival in arrivals}
        assert stamps[b"unstamped"] is None
        assert stamps[b"stamped"] is not None


async def test_an_old_stamp_arrives_as_it_was_made(bus, zenoh_app):
    arrivals = []
    bus.subscribe(keys.CMD_VEL, arrivals.extend)
    session = zenoh_app("client", bus.options.listen[0]).session
    old = zenoh.Timestamp(zenoh.NTP64(1_700_000_000, 0), bytes(session.new_timestamp().get_id()))
    session.put("bot1/cmd_vel", b"{}", timestamp=old)
    (arrival,) = await eventually(lambda: arrivals)
    assert arrival.stamp_ns == 1_700_000_000_000_000_000


async def test_too_large_a_payload_is_counted_and_not_delivered(bus, zenoh_app):
    arrivals = []
    subscription = bus.subscribe(keys.CMD_VEL, arrivals.extend, max_bytes=100)
    session = zenoh_app("client", bus.options.listen[0]).session
    for size in (1_000_000, 101, 100):
        session.put("bot1/cmd_vel", b"x" * size, congestion_control=zenoh.CongestionControl.BLOCK)
    await eventually(lambda: arrivals)
    assert [len(arrival.payload) for arrival in arrivals] == [100]
    assert subscription.counters.oversize == 2
    assert subscription.counters.received == 3


async def test_where_any_payload_counts_one_that_is_too_large_arrives_empty(bus, zenoh_app):
    arrivals = []
    bus.subscribe(keys.CMD_VEL, arrivals.extend, max_bytes=100, keep_oversize=True)
    session = zenoh_app("client", bus.options.listen[0]).session
    # In pieces, of which a busy machine would drop one.
    session.put("bot1/cmd_vel", b"x" * 1_000_000, congestion_control=zenoh.CongestionControl.BLOCK)
    (arrival,) = await eventually(lambda: arrivals)
    assert arrival.oversize
    assert arrival.payload == b""


async def test_an_attachment_counts_as_much_as_the_payload(bus, zenoh_app):
    arrivals = []
    bus.subscribe(keys.CMD_VEL, arrivals.extend, max_bytes=100, keep_oversize=True)
    session = zenoh_app("client", bus.options.listen[0]).session
    for size in (15_000_000, 51, 50):
        session.put(
            "bot1/cmd_vel",
            b"x" * 50,
            attachment=b"y" * size,
            congestion_control=zenoh.CongestionControl.BLOCK,
        )
    await eventually(lambda: len(arrivals) == 3)
    assert [arrival.oversize for arrival in arrivals] == [True, True, False]
    assert [arrival.attachment for arrival in arrivals] == [None, None, b"y" * 50]


async def test_nothing_large_is_kept_while_the_loop_stands_still(bus, zenoh_app):
    """Samples are checked as they arrive, so only small ones wait for the loop."""
    subscription = bus.subscribe(keys.CMD_VEL, lambda _: None, keep_oversize=True)
    session = zenoh_app("client", bus.options.listen[0]).session
    pause = threading.Event()
    for _ in range(3):
        session.put(
            "bot1/cmd_vel",
            b"{}",
            attachment=bytes(15_000_000),
            congestion_control=zenoh.CongestionControl.BLOCK,
        )
    while subscription.counters.received < 3:
        pause.wait(0.001)
    assert [received[0] for received in subscription._lane._entries] == [None] * 3


async def test_a_deletion_arrives_as_an_empty_payload(bus, zenoh_app):
    arrivals = []
    bus.subscribe(keys.CMD_VEL, arrivals.extend)
    zenoh_app("client", bus.options.listen[0]).session.delete("bot1/cmd_vel")
    (arrival,) = await eventually(lambda: arrivals)
    assert arrival.payload == b""


async def test_nothing_arrives_after_the_end(bus, zenoh_app):
    ended, other = [], []
    subscription = bus.subscribe(keys.CMD_VEL, ended.extend)
    app = zenoh_app("client", bus.options.listen[0])
    await app.reach("bot1/cmd_vel")
    subscription.close()
    bus.subscribe(keys.CMD_VEL, other.extend)
    app.session.put("bot1/cmd_vel", b"{}")
    await eventually(lambda: other)
    assert ended == []


async def test_a_flood_on_one_key_does_not_hold_up_another(bus, zenoh_app):
    """By order: the e-stop sent in the middle of a flood is there before the flood is through."""
    flood, order = [], []
    subscription = bus.subscribe(keys.CMD_VEL, lambda batch: flood.extend(a.payload for a in batch))
    bus.alarm(
        keys.ESTOP,
        lambda *_: order.append(flood[-1] if flood else b"-1"),
        lambda _: None,
        harmless=lambda _: False,
        idle=lambda _: None,
        asks_nothing=lambda _: False,
    )
    flooder = zenoh_app("client", bus.options.listen[0]).session
    operator = zenoh_app("client", bus.options.listen[0]).session
    publisher = flooder.declare_publisher(
        "bot1/cmd_vel", congestion_control=zenoh.CongestionControl.BLOCK
    )
    count = 60_000

    def send():
        for number in range(count):
            publisher.put(b"%d" % number)
            if number == count // 3:
                operator.put("bot1/yahboomd/estop", b"stop")

    await asyncio.to_thread(send)
    await eventually(lambda: flood and flood[-1] == b"%d" % (count - 1))
    assert len(order) == 1
    assert int(order[0]) < count - 1
    assert len(flood) < count
    assert subscription.counters.floods >= 1
    assert subscription.counters.dropped > 0


async def test_after_a_flood_samples_are_taken_one_by_one_again(bus, zenoh_app):
    arrivals = []
    subscription = bus.subscribe(keys.CMD_VEL, arrivals.extend, depth=FLOOD + 1)
    session = zenoh_app("client", bus.options.listen[0]).session
    while not subscription.counters.floods:
        for _ in range(FLOOD):
            session.put("bot1/cmd_vel", b"x", congestion_control=zenoh.CongestionControl.BLOCK)
        await asyncio.sleep(0)
    await eventually(lambda: not subscription.flooded)
    assert subscription.counters.floods == 1
    arrivals.clear()
    session.put("bot1/cmd_vel", b"after")
    await eventually(lambda: arrivals)
    assert arrivals[-1].payload == b"after"


async def test_the_newest_of_a_flood_is_delivered(bus, zenoh_app):
    arrivals = []
    subscription = bus.subscribe(keys.CMD_VEL, arrivals.extend)
    session = zenoh_app("client", bus.options.listen[0]).session
    publisher = session.declare_publisher(
        "bot1/cmd_vel", congestion_control=zenoh.CongestionControl.BLOCK
    )
    await asyncio.to_thread(lambda: [publisher.put(b"%d" % n) for n in range(20_000)])
    await eventually(lambda: arrivals and arrivals[-1].payload == b"19999")
    await eventually(lambda: not subscription.flooded)
    assert arrivals[-1].payload == b"19999"


async def test_a_backlog_of_a_stalled_link_is_no_flood(bus, zenoh_app):
    arrivals = []
    subscription = bus.subscribe(keys.CMD_VEL, arrivals.extend, depth=64)
    session = zenoh_app("client", bus.options.listen[0]).session
    for number in range(200):
        session.put(
            "bot1/cmd_vel", b"%d" % number, congestion_control=zenoh.CongestionControl.BLOCK
        )
    await eventually(lambda: arrivals and arrivals[-1].payload == b"199")
    assert subscription.counters.floods == 0


class Ring:
    """A ring as Zenoh offers it to its reader."""

    def __init__(self, samples):
        self.samples = list(samples)

    def try_recv(self):
        return self.samples.pop(0) if self.samples else None


async def test_a_full_ring_tells_of_a_loss_and_large_samples_are_let_go_at_once(bus):
    samples = []
    bus._sessions[0].declare_subscriber("x", samples.append)
    for size in (1, 20, 1, 1):
        bus._sessions[0].put("x", b"x" * size)
    await eventually(lambda: len(samples) == RING)
    inbox, batches = Inbox(), []
    subscription = Subscription(
        "x",
        "bot1/x",
        batches.append,
        inbox=inbox,
        now_ns=bus._clock.now_ns,
        stamp_ns=lambda timestamp: None,
        wall_ns=bus._clock.wall_ns,
        depth=64,
        max_bytes=10,
        keep_oversize=True,
    )
    batch, taken = subscription._drain(Ring(samples))
    assert [received[0] is None for received in batch] == [False, True, False, False]
    subscription._rings = [Ring(samples)]
    subscription._look_into_rings()
    subscription._rings = [Ring(samples[:-1])]
    subscription._look_into_rings()
    subscription._rings = []
    assert taken == RING
    assert [(len(batch), batch[0].dropped) for batch in batches] == [(RING, 1), (RING - 1, 0)]
    assert subscription.counters.oversize == 3
    subscription.close()
    inbox.close()


async def test_gathered_samples_come_late_all_at_once_with_the_time_of_their_arrival(bus):
    batches = []
    subscription = bus.subscribe("x", batches.append, gather_s=0.5)
    # Two turns, so that all come within one.
    loop = asyncio.get_running_loop()
    before = loop.time() // 0.5
    await eventually(lambda: loop.time() // 0.5 > before)
    moments_ns = [bus._clock.now_ns()]
    for number in range(3):
        bus._sessions[0].put("bot1/x", str(number))
        moments_ns.append(bus._clock.now_ns())
    await eventually(lambda: batches)
    (batch,) = batches
    assert [arrival.payload for arrival in batch] == [b"0", b"1", b"2"]
    near_ns = 100_000_000
    for arrival, (before_ns, after_ns) in zip(batch, itertools.pairwise(moments_ns), strict=True):
        assert before_ns - near_ns < arrival.arrived_ns < after_ns + near_ns
    assert subscription.counters.dropped == 0


async def test_more_than_is_gathered_counts_as_a_loss(bus):
    batches = []
    bus.subscribe("x", batches.append, gather_s=0.2, depth=2)
    for number in range(5):
        bus._sessions[0].put("bot1/x", str(number))
    await eventually(lambda: batches)
    assert sum(len(batch) for batch in batches) < 5
    assert batches[0][0].dropped == 1


async def test_a_flood_through_both_sessions_ends_in_both(zenoh_router, zenoh_app):
    zenoh_router.start()
    options = BusOptions(listen=(free_endpoint(),), connect=(zenoh_router.endpoint,))
    async with Bus(options) as bus:
        arrivals = []
        subscription = bus.subscribe(keys.CMD_VEL, arrivals.extend)
        await eventually(lambda: bus.neighbours)
        apps = [
            zenoh_app("client", endpoint) for endpoint in (zenoh_router.endpoint, options.listen[0])
        ]
        for app in apps:
            await app.reach("cmd_vel")
        while not subscription.flooded:
            for _ in range(FLOOD):
                for app in apps:
                    app.session.put(
                        "cmd_vel", b"x", congestion_control=zenoh.CongestionControl.BLOCK
                    )
            await asyncio.sleep(0)
        await eventually(lambda: not subscription.flooded)
        for number, app in enumerate(apps):
            app.session.put("cmd_vel", b"after %d" % number)
        await eventually(
            lambda: {b"after 0", b"after 1"} <= {arrival.payload for arrival in arrivals}
        )
        assert not subscription.flooded
