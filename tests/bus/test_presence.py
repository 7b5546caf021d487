import pytest
from zenoh_fixtures import eventually

from yahboomd.bus import keys
from yahboomd.bus.presence import stamp_id, stamper

pytestmark = pytest.mark.realtime


async def test_applications_see_the_token_come_and_go(bus, zenoh_app):
    app = zenoh_app("client", bus.options.listen[0])
    seen = app.session.liveliness().declare_subscriber("bot1/yahboomd/alive", history=True)
    token = bus.token(keys.ALIVE)
    assert str((await eventually(seen.try_recv)).kind).endswith("PUT")
    token.close()
    assert str((await eventually(seen.try_recv)).kind).endswith("DELETE")


async def test_a_second_holder_is_noticed_and_so_is_its_end(bus, zenoh_app):
    changes = []
    bus.token(keys.holder_key(keys.ALIVE, bus.zid))
    bus.watch_tokens(f"{keys.ALIVE}/*", changes.extend)
    alive = bus.key(keys.ALIVE)
    await eventually(lambda: changes)
    assert [keys.holder_of(alive, change.key) for change in changes] == [bus.zid]

    app = zenoh_app("client", bus.options.listen[0])
    other = str(app.session.zid())
    token = app.session.liveliness().declare_token(keys.holder_key(alive, other))
    await eventually(lambda: len(changes) == 2)
    token.undeclare()
    await eventually(lambda: len(changes) == 3)
    assert [(keys.holder_of(alive, change.key), change.present) for change in changes[1:]] == [
        (other, True),
        (other, False),
    ]


async def test_neighbours_are_told_as_they_come_and_go(bus, zenoh_app):
    changes = []
    bus.watch_neighbours(changes.extend)
    app = zenoh_app("client", bus.options.listen[0])
    await eventually(lambda: bus.neighbours)
    (neighbour,) = bus.neighbours
    assert neighbour.zid == str(app.session.zid())
    assert neighbour.kind == "client"
    assert neighbour.address.startswith("tcp/127.0.0.1:")
    app.session.close()
    await eventually(lambda: not bus.neighbours)
    assert [(change.neighbour, change.present) for change in changes] == [
        (neighbour, True),
        (neighbour, False),
    ]


async def test_the_stamper_of_a_timestamp_is_the_session_that_made_it(zenoh_app, bus):
    session = zenoh_app("client", bus.options.listen[0]).session
    assert stamper(session.new_timestamp()) == stamp_id(str(session.zid()))
    assert stamper(session.new_timestamp()) != stamp_id(bus.zid)
