"""Opening and closing real sessions: errors in words, the uplink, stuck connections."""

import asyncio
import json
import os
import socket
import threading
from contextlib import suppress

import pytest
import zenoh
from zenoh_fixtures import eventually, free_endpoint, late_subscriber

from yahboomd.core.bus import keys
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.options import BusOptions, zenoh_config
from yahboomd.core.bus.zenoh_sessions import hang_up_stuck, open_failure, open_uplink, port_holder
from yahboomd.core.errors import BusError


@pytest.fixture
def listener():
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        yield listening.getsockname()[1]


def failure(options):
    with pytest.raises(zenoh.ZError) as caught:
        zenoh.open(zenoh_config(options))
    error = open_failure(caught.value, options)
    assert isinstance(error, BusError)
    assert ".rs:" not in str(error)
    return error


def test_who_listens_on_a_port_is_found(listener):
    holder = port_holder(listener)
    assert holder is not None
    assert holder.endswith(f"({os.getpid()})")


def test_who_listens_is_found_while_its_other_files_come_and_go():
    with open(os.devnull) as other, socket.create_server(("127.0.0.1", 0)) as listening:
        # Its number is the first that is free, and is gone once the files have been listed.
        other.close()
        holder = port_holder(listening.getsockname()[1])
    assert holder is not None
    assert holder.endswith(f"({os.getpid()})")


def test_a_free_port_has_no_listener():
    assert port_holder(int(free_endpoint().rpartition(":")[2])) is None


def test_an_address_in_use_is_reported_with_its_holder_and_the_remedy(listener):
    endpoint = f"tcp/127.0.0.1:{listener}"
    error = failure(BusOptions(listen=(endpoint,), connect=()))
    assert endpoint in error.message
    assert f"({os.getpid()})" in error.message
    assert "zenoh.listen" in error.remedy


def test_an_address_of_another_machine_is_reported():
    error = failure(BusOptions(listen=("tcp/192.0.2.1:7448",), connect=()))
    assert "no address tcp/192.0.2.1:7448" in error.message


def rmw_zenoh_node(endpoint):
    """A session with what rmw_zenoh's own configuration has for nodes."""
    config = zenoh.Config()
    for key, value in {
        "mode": "peer",
        "connect/endpoints": [endpoint],
        "listen/endpoints": ["tcp/127.0.0.1:0"],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": True,
        "scouting/gossip/autoconnect": {"router": [], "peer": ["router", "peer"]},
    }.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


async def test_nodes_of_a_router_that_gossips_hear_each_other():
    endpoint = free_endpoint()
    options = BusOptions(listen=(endpoint,), connect=(), gossip=True)
    with (
        zenoh.open(zenoh_config(options)),
        rmw_zenoh_node(endpoint) as talker,
        rmw_zenoh_node(endpoint) as listener,
    ):
        heard = []
        listener.declare_subscriber("0/chatter", lambda sample: heard.append(bytes(sample.payload)))

        def talked():
            talker.put("0/chatter", b"hello")
            return heard

        await eventually(talked)
        assert heard[0] == b"hello"


def test_a_missing_router_is_reported_to_a_client():
    endpoint = free_endpoint()
    error = failure(BusOptions(mode="client", connect=(endpoint,)))
    assert endpoint in error.message
    assert "'router'" in error.remedy


def test_a_socket_in_a_missing_folder_is_reported(tmp_path):
    path = tmp_path / "missing" / "bus.sock"
    error = failure(BusOptions(listen=(), connect=(), unix_socket=path))
    assert str(path) in error.message
    assert "folder" in error.remedy


def test_tls_without_certificates_is_reported():
    endpoint = free_endpoint().replace("tcp", "tls")
    error = failure(BusOptions(listen=(endpoint,), connect=()))
    assert "TLS" in error.message
    assert "zenoh.config" in error.remedy


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
        bus.publisher("tf_static", cache=1).put(b"static frames")
        zenoh_router.start()
        await eventually(lambda: bus.neighbours)
        app = zenoh_app("client", zenoh_router.endpoint)
        with late_subscriber(app.session, "tf_static") as heard:
            assert (await eventually(lambda: heard))[0].payload == b"static frames"


async def test_what_was_ended_before_a_router_came_stays_ended(zenoh_router, zenoh_app):
    options = BusOptions(listen=(free_endpoint(),), connect=(zenoh_router.endpoint,))
    async with Bus(options) as bus:
        ended, kept = [], []
        bus.subscribe(keys.CMD_VEL, ended.extend).close()
        bus.subscribe(keys.CMD_VEL, kept.extend)
        zenoh_router.start()
        await eventually(lambda: bus.neighbours)
        app = zenoh_app("client", zenoh_router.endpoint)
        await app.reach("cmd_vel")
        app.session.put("cmd_vel", b"x")
        await eventually(lambda: kept)
        assert ended == []


@pytest.fixture
def connection():
    with socket.create_server(("127.0.0.1", 0)) as server:
        near = socket.create_connection(server.getsockname())
        far, _ = server.accept()
        with near, far:
            yield near, far


def ends(near):
    return tuple("tcp/{}:{}".format(*end) for end in (near.getsockname(), near.getpeername()))


def fill(near):
    near.setblocking(False)
    with suppress(BlockingIOError):
        while True:
            near.send(b"x" * 65536)


def is_shut(near):
    near.settimeout(0)
    try:
        return near.recv(1) == b""
    except BlockingIOError:
        return False


def test_a_connection_that_takes_nothing_is_hung_up_on(connection):
    near, _ = connection
    fill(near)
    link = ends(near)
    assert hang_up_stuck(lambda: [] if is_shut(near) else [link]) == [link[1]]
    assert is_shut(near)


def test_a_connection_with_nothing_waiting_is_left_alone(connection):
    near, far = connection
    near.send(b"read and acknowledged")
    far.recv(100)
    assert hang_up_stuck(lambda: [ends(near)]) == []
    assert not is_shut(near)


def test_sockets_that_are_not_named_are_left_alone(connection):
    near, _ = connection
    fill(near)
    assert hang_up_stuck(lambda: [("tcp/127.0.0.1:1", "tcp/127.0.0.1:2")]) == []
    assert not is_shut(near)


def test_no_descriptor_is_lost_by_looking(connection):
    near, _ = connection
    fill(near)
    hang_up_stuck(lambda: [] if is_shut(near) else [ends(near)])
    copies = []
    for fd in os.listdir("/proc/self/fd"):
        with suppress(OSError):
            copies += [fd] * os.path.sameopenfile(int(fd), near.fileno())
    assert copies == [str(near.fileno())]
