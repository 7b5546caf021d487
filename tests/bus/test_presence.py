import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from zenoh_fixtures import eventually, free_endpoint

from yahboomd.core.bus import keys
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.options import BusOptions
from yahboomd.core.bus.presence import MOST_TOKENS, TokenChange, TokenWatch

pytestmark = pytest.mark.usefixtures("fake_zenoh")


async def test_a_second_holder_is_noticed_and_so_is_its_end(bus, app):
    changes = []
    bus.token(keys.holder_key(keys.ALIVE, bus.zid))
    bus.watch_tokens(f"{keys.ALIVE}/*", changes.extend)
    alive = bus.key(keys.ALIVE)
    await eventually(lambda: changes)
    assert [keys.holder_of(alive, change.key) for change in changes] == [bus.zid]

    other = str(app.session.zid())
    token = app.session.liveliness().declare_token(keys.holder_key(alive, other))
    await eventually(lambda: len(changes) == 2)
    token.undeclare()
    await eventually(lambda: len(changes) == 3)
    assert [(keys.holder_of(alive, change.key), change.present) for change in changes[1:]] == [
        (other, True),
        (other, False),
    ]


async def test_neighbours_are_reported_as_they_come_and_go(bus, zenoh_app):
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


def seen(*changes):
    """The changes that a watch reports, each in a turn of its own, and those it ignored."""
    reported = []

    class Inbox:
        def lane(self, handler, **_):
            class Lane:
                def offer(self, entry):
                    handler([entry], 0)

            return Lane()

    watch = TokenWatch("alive/*", reported.extend, Inbox())
    for key, session, present in changes:
        watch.note_token(key, session, present=present)
    return reported, watch


def test_a_token_is_there_as_long_as_one_session_sees_it():
    come, gone = (TokenChange(key="alive/a", present=present) for present in (True, False))
    both = [("alive/a", 0, True), ("alive/a", 1, True), ("alive/a", 0, False)]
    assert seen(*both)[0] == [come]
    assert seen(*both, ("alive/a", 1, False))[0] == [come, gone]
    assert seen(*both, ("alive/a", 0, True), ("alive/a", 1, False))[0] == [come]
    # An unknown neighbour, or a repeated report, changes nothing.
    assert seen(("alive/a", 0, False), ("alive/a", 0, True), ("alive/a", 0, True))[0] == [come]


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(
        st.tuples(st.sampled_from(["alive/a", "alive/b"]), st.integers(0, 1), st.booleans()),
        max_size=30,
    )
)
def test_what_was_reported_of_tokens_is_what_the_sessions_see(changes):
    truth = set()
    for key, session, present in changes:
        (truth.add if present else truth.discard)((key, session))
    believed = set()
    for change in seen(*changes)[0]:
        (believed.add if change.present else believed.remove)(change.key)
    assert believed == {key for key, _ in truth}


def test_foreign_tokens_fill_a_bounded_table_and_the_rest_is_counted():
    many = [(f"alive/{number}", 0, True) for number in range(MOST_TOKENS + 100)]
    reported, watch = seen(*many)
    assert len(reported) == len(watch._present) == MOST_TOKENS
    assert watch.ignored == 100
    # One that is known keeps its place, and the end of one that is not changes nothing.
    watch.note_token("alive/0", 1, present=True)
    watch.note_token(f"alive/{MOST_TOKENS + 1}", 0, present=False)
    assert (len(watch._present), watch.ignored) == (MOST_TOKENS, 100)
    watch.note_token("alive/" + "x" * 60_000, 0, present=True)
    assert watch.ignored == 101


async def test_a_neighbour_of_both_sessions_is_there_until_the_last_connection_ends(
    bus, app, turns
):
    """A peer that is connected to the robot and to the router that the robot joined."""
    changes = []
    bus.watch_neighbours(changes.extend)
    neighbours, zid = bus._neighbours, str(app.session.zid())
    await turns()
    # The other session's view comes as its listener would tell it.
    for present in (True, False, True):
        neighbours._changed([(1, zid, "client", present)], 0)
    app.session.close()
    await turns()
    assert neighbours._seen_by[zid] == {1}
    assert zid in {each.zid for each in bus.neighbours}
    neighbours._changed([(1, zid, "client", False)], 0)
    assert [(each.neighbour.zid, each.present) for each in changes] == [(zid, True), (zid, False)]


async def test_connections_whose_changes_were_lost_are_found_out(bus, app):
    changes = []
    bus.watch_neighbours(changes.extend)
    zid = str(app.session.zid())
    await eventually(lambda: changes)
    neighbours = bus._neighbours
    ghost = "ab12"
    neighbours._changed([(0, ghost, "client", True)], 0)
    neighbours._changed([(0, zid, "client", False)], 0)
    neighbours._changed([], 2)
    assert [each.zid for each in bus.neighbours] == [zid]
    assert [(each.neighbour.zid, each.present) for each in changes[1:]] == [
        (ghost, True),
        (zid, False),
        (zid, True),
        (ghost, False),
    ]


async def test_two_robots_tell_each_other_apart_on_one_router(fake_zenoh):
    place = free_endpoint()
    fake_zenoh.open_router(place)
    buses = [Bus(BusOptions(listen=(free_endpoint(),), connect=(place,))) for _ in range(2)]
    alive = [[], []]
    async with buses[0], buses[1]:
        for bus, seen in zip(buses, alive, strict=True):
            bus.token(keys.holder_key(keys.ALIVE, bus.zid))
            bus.watch_tokens(f"{keys.ALIVE}/*", seen.extend)
        both = {keys.holder_key(keys.ALIVE, bus.zid) for bus in buses}
        for seen in alive:
            await eventually(lambda seen=seen: {change.key for change in seen} == both)
