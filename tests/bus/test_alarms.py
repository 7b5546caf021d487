import asyncio
import threading

import pytest
import zenoh
from zenoh_fixtures import eventually

from yahboomd.core.bus import keys
from yahboomd.core.bus.alarms import READ_BYTES, AlarmSubscriber
from yahboomd.core.bus.inbox import Inbox

pytestmark = pytest.mark.realtime

BLOCK = {"congestion_control": zenoh.CongestionControl.BLOCK}


def harmless(payload):
    assert len(payload) <= READ_BYTES
    if payload == b"broken":
        raise ValueError
    return payload.startswith(b"harmless")


def asks_nothing(payload):
    return payload == b"not pressed"


class Heard:
    """The results of an alarm."""

    def __init__(self, bus):
        self.order = []
        self.raised = self.unread = self.ignored = self.idle = 0
        self.alarm = bus.alarm(
            keys.ESTOP,
            self.raise_,
            self.ignore,
            harmless=harmless,
            idle=self.count_idle,
            asks_nothing=asks_nothing,
        )

    def raise_(self, count, unread):
        self.order.append("raised")
        self.raised += count
        self.unread += unread

    def ignore(self, count):
        self.order.append("ignored")
        self.ignored += count

    def count_idle(self, count):
        self.idle += count


@pytest.fixture
def heard(bus):
    return Heard(bus)


@pytest.fixture
def session(bus, zenoh_app):
    return zenoh_app("client", bus.options.listen[0]).session


@pytest.mark.parametrize(
    ("payload", "attachment", "expected"),
    [
        (b"harmless", None, (0, 0, 1)),
        (b"harmless", b"x" * 33, (0, 0, 1)),
        (b"harmless" + b" " * (READ_BYTES - 8), None, (0, 0, 1)),
        (b"", None, (1, 0, 0)),
        (b"anything", None, (1, 0, 0)),
        (b"broken", None, (1, 0, 0)),
        (b"harmless" + b" " * (READ_BYTES - 7), None, (1, 1, 0)),
        (b"harmless", bytes(15_000_000), (1, 1, 0)),
        (bytes(15_000_000), None, (1, 1, 0)),
    ],
    ids=[
        "harmless",
        "with an attachment",
        "as long as can be",
        "empty",
        "anything",
        "what cannot be judged",
        "too long",
        "an attachment that is too long",
        "megabytes",
    ],
)
async def test_a_sample_raises_the_alarm_unless_it_is_short_and_harmless(
    heard, session, payload, attachment, expected
):
    session.put("bot1/yahboomd/estop", payload, attachment=attachment, **BLOCK)
    await eventually(lambda: heard.raised or heard.ignored)
    assert (heard.raised, heard.unread, heard.ignored) == expected


async def test_a_deletion_and_a_sample_for_every_key_raise_it_too(heard, session):
    session.delete("bot1/yahboomd/estop")
    session.put("**", b"x")
    await eventually(lambda: heard.raised == 2)


async def test_a_flood_of_harmless_samples_hides_no_alarm_and_raises_none(heard, session):
    """The loop stands still while they come: 5,000 harmless samples, an alarm, 5,000 more."""

    def count():
        return heard.alarm._ignored.counters.received

    pause = threading.Event()
    for wanted in (5_000, 10_000):
        for _ in range(5_000):
            session.put("bot1/yahboomd/estop", b"harmless", **BLOCK)
        while count() < wanted:
            pause.wait(0.001)
        if wanted == 5_000:
            session.put("bot1/yahboomd/estop", b"stop", **BLOCK)
    await eventually(lambda: heard.ignored == 10_000)
    assert heard.raised == 1
    assert heard.order[0] == "raised"


async def test_alarms_beyond_what_a_lane_holds_are_counted_all_the_same(heard, session):
    pause = threading.Event()
    for number in range(1_000):
        session.put("bot1/yahboomd/estop", b"%d" % number, **BLOCK)
    while heard.alarm._alarms.counters.received < 1_000:
        pause.wait(0.001)
    assert heard.raised == 0
    await eventually(lambda: heard.raised)
    assert heard.raised == 1_000


async def test_nothing_of_a_sample_is_kept(session):
    inbox = Inbox()
    alarm = AlarmSubscriber(
        "bot1/x",
        print,
        print,
        harmless=harmless,
        idle=print,
        asks_nothing=asks_nothing,
        inbox=inbox,
    )
    entries = []
    alarm._alarms.offer = entries.append
    alarm._ignored.offer = entries.append
    alarm.attach(session)
    session.put("bot1/x", bytes(15_000_000), attachment=bytes(1_000_000), **BLOCK)
    session.put("bot1/x", b"harmless", **BLOCK)
    session.put("bot1/x", b"stop", **BLOCK)
    await eventually(lambda: len(entries) == 3)
    assert entries == [True, None, False]
    inbox.close()


async def test_every_alarm_of_many_clients_in_a_flood_is_counted(bus, heard, zenoh_app):
    flooder = zenoh_app("client", bus.options.listen[0]).session
    operator = zenoh_app("client", bus.options.listen[0]).session

    def send():
        for number in range(20_000):
            flooder.put("bot1/yahboomd/estop", b"harmless", **BLOCK)
            if number % 2_000 == 1_000:
                operator.put("bot1/yahboomd/estop", b"stop", **BLOCK)

    await asyncio.to_thread(send)
    # The operator's come over a connection of their own, and may be the last.
    await eventually(lambda: (heard.ignored, heard.raised) == (20_000, 10))


async def test_samples_that_ask_for_nothing_are_counted_and_nothing_else(heard, session):
    for _ in range(100):
        session.put("bot1/yahboomd/estop", b"not pressed", **BLOCK)
    await eventually(lambda: heard.idle == 100)
    assert (heard.raised, heard.ignored) == (0, 0)
