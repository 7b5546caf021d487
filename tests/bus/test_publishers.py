import pytest
from zenoh_fixtures import eventually

from yahboomd.core.bus import keys
from yahboomd.core.bus.publishers import BusPublisher

pytestmark = pytest.mark.usefixtures("fake_zenoh")


async def test_whether_anybody_listens_follows_the_subscribers(bus, app):
    subscriber = app.session.declare_subscriber("bot1/yahboomd/pose")
    await eventually(lambda: bus.neighbours)
    early = bus.publisher(keys.POSE)
    await eventually(lambda: early.has_subscribers)
    late = bus.publisher(keys.POSE)
    assert late.has_subscribers
    assert not bus.publisher(keys.TWIST).has_subscribers
    subscriber.undeclare()
    await eventually(lambda: not early.has_subscribers and not late.has_subscribers)


async def test_put_after_the_end_is_counted_and_not_raised(bus):
    publisher = bus.publisher(keys.POSE)
    await bus.close()
    assert not publisher.put(b"x")
    assert not publisher.put(b"x")
    assert publisher.counters.errors == 2


class PanickingOutlet:
    """As Zenoh's library: a panic is no Exception."""

    matching = True

    def put(self, _payload, attachment):
        raise BaseException(f"panicked with {attachment}")


def test_put_that_panics_is_counted_and_not_raised():
    publisher = BusPublisher(keys.POSE, encoding="", priority="data", express=False, cache=0)
    publisher._outlets.append(PanickingOutlet())
    assert not publisher.put(b"x")
    assert publisher.counters.errors == 1
