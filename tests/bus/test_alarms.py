import pytest

from yahboomd.core.bus import keys
from yahboomd.core.bus.alarms import READ_BYTES

pytestmark = pytest.mark.usefixtures("fake_zenoh")

KEY = "bot1/yahboomd/estop"


def harmless(payload):
    assert len(payload) <= READ_BYTES
    if payload == b"broken":
        raise ValueError
    return payload.startswith(b"harmless")


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
            asks_nothing=lambda payload: payload == b"not pressed",
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
def session(app):
    return app.session


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
    heard, session, turns, payload, attachment, expected
):
    session.put(KEY, payload, attachment=attachment)
    # The decision is kept, and nothing of the sample.
    kept = [*heard.alarm._alarms._entries, *heard.alarm._ignored._entries]
    assert kept in ([True], [False], [None])
    await turns()
    assert (heard.raised, heard.unread, heard.ignored) == expected


async def test_a_deletion_and_a_sample_for_every_key_raise_it_too(heard, session, turns):
    session.delete(KEY)
    session.put("**", b"x")
    await turns()
    assert heard.raised == 2


async def test_a_flood_of_harmless_samples_hides_no_alarm_and_raises_none(heard, session, turns):
    """The loop stands still while they come: 1,000 harmless samples, an alarm, 1,000 more."""
    for payload, count in ((b"harmless", 1_000), (b"stop", 1), (b"harmless", 1_000)):
        for _ in range(count):
            session.put(KEY, payload)
    await turns()
    assert (heard.ignored, heard.raised) == (2_000, 1)
    assert heard.order[0] == "raised"


async def test_alarms_beyond_what_a_lane_holds_are_counted_all_the_same(heard, session, turns):
    for number in range(1_000):
        session.put(KEY, b"%d" % number)
    assert heard.raised == 0
    await turns()
    assert heard.raised == 1_000


async def test_samples_that_ask_for_nothing_are_counted_and_nothing_else(heard, session, turns):
    for _ in range(100):
        session.put(KEY, b"not pressed")
    await turns()
    assert (heard.idle, heard.raised, heard.ignored) == (100, 0, 0)
