"""The bus on real Zenoh sessions, which those in memory are compared with."""

import asyncio
import json
import os
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest
import zenoh
from zenoh_fixtures import PATIENCE_S, eventually, free_endpoint, late_subscriber

from yahboomd.core.bus import keys
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.inbox import carried_bytes
from yahboomd.core.bus.options import BusOptions, zenoh_config
from yahboomd.core.bus.presence import stamp_id, stamper
from yahboomd.core.bus.services import Response, Service
from yahboomd.core.bus.subscriptions import FLOOD
from yahboomd.core.bus.zenoh_sessions import open_failure
from yahboomd.core.errors import BusError

pytestmark = pytest.mark.realtime

BLOCK = {"congestion_control": zenoh.CongestionControl.BLOCK}


def refusal(reason, _request):
    return Response(payload=reason.encode())


async def conversation(bus, app):
    """All that tests of the bus take from a session, as both sides see it."""
    seen = {}
    heard, changes, tokens, status = [], [], [], []
    bus.watch_neighbours(changes.extend)
    await eventually(lambda: bus.neighbours)
    (neighbour,) = bus.neighbours
    assert neighbour.zid == str(app.session.zid())
    seen["neighbour"] = neighbour.kind

    # Samples to the bus.
    session = bus.session
    session.declare_subscriber("bot1/in", heard.append)
    arrivals = []
    bus.subscribe("in", arrivals.extend)
    await app.reach("bot1/in")
    old = zenoh.Timestamp(
        zenoh.NTP64(1_700_000_000, 0), bytes(app.session.new_timestamp().get_id())
    )
    app.session.put("bot1/in", b"12345", attachment=b"123", timestamp=old, **BLOCK)
    app.session.put("bot1/in", b"text", encoding="application/json;x", **BLOCK)
    app.session.delete("bot1/in", **BLOCK)
    app.session.put("**", b"all", **BLOCK)
    await eventually(lambda: len(heard) == len(arrivals) == 4)
    seen["in"] = [
        (
            str(each.key_expr),
            each.payload.to_bytes(),
            each.attachment and each.attachment.to_bytes(),
            str(each.encoding),
            each.kind,
            carried_bytes(each),
            each.timestamp is None or stamper(each.timestamp) == stamp_id(str(app.session.zid())),
        )
        for each in heard
    ]
    seen["stamps"] = [each.stamp_ns for each in arrivals]

    # Samples from it.
    pose = bus.publisher("pose", encoding="application/msgpack;pose", express=True)
    assert not pose.has_subscribers
    subscriber = app.session.declare_subscriber("bot1/pose", status.append)
    await eventually(lambda: pose.has_subscribers)
    pose.put(b"\x81\x00", attachment=b"gid")
    await eventually(lambda: status)
    seen["out"] = [
        (
            *(each.payload.to_bytes(), each.attachment.to_bytes(), str(each.encoding)),
            *(each.priority, each.congestion_control, each.express),
        )
        for each in status
    ]
    subscriber.undeclare()
    await eventually(lambda: not pose.has_subscribers)

    # Questions.
    def answer(request):
        words = f"{request.selector} {request.payload} {request.encoding} {request.attachment}"
        return Response(payload=words.encode(), encoding="application/json", attachment=b"seq")

    service = bus.serve("board", answer, fallback=refusal, wildcards=True, max_bytes=100)
    session.declare_queryable("bot1/half", lambda query: query.drop())
    while not await app.ask("bot1/board"):
        await asyncio.sleep(0.01)
    seen["answers"] = []
    for selector, carried in {
        "bot1/board": {"payload": b"{}", "encoding": "application/json", "attachment": b"gid"},
        "bot1/board?long=1": {},
        "*/board": {"payload": b"\0" * 101},
        "bot1/half": {},
        "bot1/none": {},
    }.items():
        replies = await app.ask(selector, **carried)
        seen["answers"] += [
            (
                *(selector, str(each.ok.key_expr), each.ok.payload.to_bytes()),
                *(str(each.ok.encoding), each.ok.attachment and each.ok.attachment.to_bytes()),
            )
            for each in replies
        ]
    seen["counters"] = service.counters.requests, service.counters.refused

    # Tokens, and the end.
    bus.watch_tokens("alive/*", tokens.extend)
    watching = app.session.liveliness().declare_subscriber("bot1/alive/*", history=True)
    theirs = app.session.liveliness().declare_token("bot1/alive/them")
    bus.token("alive/us")
    await eventually(lambda: len(tokens) == 2)
    theirs.undeclare()
    await eventually(lambda: len(tokens) == 3)
    seen["tokens"] = {(each.key, each.present) for each in tokens}
    kept = []
    await bus.close()
    await eventually(lambda: kept.append(watching.try_recv()) or sum(map(bool, kept)) == 4)
    seen["their tokens"] = {
        (str(each.key_expr), each.kind == zenoh.SampleKind.PUT) for each in filter(None, kept)
    }
    assert not pose.put(b"x")
    seen["lost"] = pose.counters.puts, pose.counters.errors
    return seen


async def test_sessions_in_memory_do_as_real_ones_do(request, zenoh_app):
    found = []
    for real in (True, False):
        if not real:
            request.getfixturevalue("fake_zenoh")
        options = BusOptions(listen=(free_endpoint(),), connect=(), namespace="bot1")
        async with Bus(options) as bus:
            found.append(await conversation(bus, zenoh_app("client", options.listen[0])))
    assert found[0] == found[1]
    # A sender that does not stamp is stamped by us, which tells nothing.
    assert found[0]["stamps"] == [1_700_000_000_000_000_000, None, None, None]
    assert [each[5] for each in found[0]["in"]] == [8, 4, 0, 3]


async def exercise(bus, app, *, ways=1):
    """Data both ways, a query and a token between the robot and an application."""
    commands = []
    subscription = bus.subscribe(keys.CMD_VEL, commands.extend)
    pose = bus.publisher(keys.POSE)
    if not any(isinstance(each, Service) for each in bus._declared):
        bus.serve(keys.ESTOP, lambda _: Response(payload=b"engaged"), fallback=refusal)
        bus.token(keys.ALIVE)
    poses = app.collect(bus.key(keys.POSE))
    await app.reach(bus.key(keys.CMD_VEL))
    await eventually(lambda: pose.has_subscribers)

    for number in range(10):
        app.session.put(bus.key(keys.CMD_VEL), b"%d" % number)
        pose.put(b"%d" % number)
    numbers = list(range(10))

    def got(payloads):
        counted = [int(payload) for payload in payloads]
        return counted if {*counted} == {*numbers} else None

    for received in (
        await eventually(lambda: got(sample.payload.to_bytes() for sample in poses)),
        await eventually(lambda: got(command.payload for command in commands)),
    ):
        assert received == numbers or ways > 1
    (reply,) = await app.ask(bus.key(keys.ESTOP))
    assert reply.ok.payload.to_bytes() == b"engaged"
    alive = app.session.liveliness().declare_subscriber(bus.key(keys.ALIVE), history=True)
    await eventually(alive.try_recv)
    subscription.close()


def routers(bus):
    return [neighbour for neighbour in bus.neighbours if neighbour.kind == "router"]


@pytest.fixture
async def robot(zenoh_router):
    """A bus as it is by default, on other ports: it joins the router when that is there."""
    bus = Bus(BusOptions(listen=(free_endpoint(),), connect=(zenoh_router.endpoint,)))
    async with bus:
        yield bus


async def test_a_peer_reaches_the_robot_directly(robot, zenoh_app):
    await exercise(robot, zenoh_app("peer", robot.options.listen[0]))


@pytest.mark.parametrize("mode", ["client", pytest.param("peer", marks=pytest.mark.nightly)])
async def test_applications_reach_the_robot_through_a_router_that_comes_later(
    robot, zenoh_router, zenoh_app, mode
):
    zenoh_router.start()
    (router,) = await eventually(lambda: routers(robot))
    assert router.address == zenoh_router.endpoint
    await exercise(robot, zenoh_app(mode, zenoh_router.endpoint))


async def test_the_robot_outlives_its_router_and_joins_it_again(robot, zenoh_router, zenoh_app):
    direct = zenoh_app("peer", robot.options.listen[0])
    changes = []
    robot.watch_neighbours(changes.extend)
    for _ in range(2):
        zenoh_router.start()
        await eventually(lambda: routers(robot))
        await exercise(robot, zenoh_app("client", zenoh_router.endpoint))
        zenoh_router.kill()
        await eventually(lambda: not routers(robot))
        await exercise(robot, direct)
    presence = [change.present for change in changes if change.neighbour.kind == "router"]
    assert presence == [True, False, True, False]


@pytest.mark.nightly
async def test_an_application_with_two_ways_to_the_robot_loses_nothing(
    robot, zenoh_router, zenoh_app
):
    zenoh_router.start()
    await eventually(lambda: routers(robot))
    app = zenoh_app(
        "peer",
        zenoh_router.endpoint,
        {"connect/endpoints": [zenoh_router.endpoint, robot.options.listen[0]]},
    )
    await eventually(lambda: len(app.session.info.routers_zid()) == 2)
    # A client of both routers sends and receives samples twice.
    await exercise(robot, app, ways=2)


async def test_an_application_reaches_the_robot_by_a_unix_socket(zenoh_app, tmp_path):
    endpoint = f"unixsock-stream/{tmp_path}/bus.sock"
    async with Bus(BusOptions(listen=(endpoint,), connect=())) as bus:
        await exercise(bus, zenoh_app("client", endpoint))


def listening_addresses():
    """The addresses that this process listens on, as the kernel lists them."""
    inodes = set()
    for fd in os.listdir("/proc/self/fd"):
        try:
            inodes.add(os.readlink(f"/proc/self/fd/{fd}"))
        except OSError:
            continue
    found = []
    for table in ("tcp", "tcp6", "udp", "udp6"):
        for line in Path("/proc/net", table).read_text().splitlines()[1:]:
            fields = line.split()
            if f"socket:[{fields[9]}]" in inodes and (table[:3] == "udp" or fields[3] == "0A"):
                address, _, port = fields[1].partition(":")
                found.append((table, address, int(port, 16)))
    return found


async def test_only_loopback_is_listened_on(robot):
    loopback = socket.htonl(0x7F000001)
    port = int(robot.options.listen[0].rpartition(":")[2])
    # That of a session before may be about to close.
    await eventually(lambda: listening_addresses() == [("tcp", f"{loopback:08X}", port)])


async def test_a_client_and_a_peer_can_be_the_robot_too(zenoh_router, zenoh_app):
    zenoh_router.start()
    async with Bus(BusOptions(mode="client", connect=(zenoh_router.endpoint,))) as bus:
        await exercise(bus, zenoh_app("client", zenoh_router.endpoint))
    async with Bus(BusOptions(mode="peer", listen=(free_endpoint(),), connect=())) as bus:
        await exercise(bus, zenoh_app("peer", bus.options.listen[0]))


async def test_an_open_that_never_returns_is_given_up(tmp_path):
    path = tmp_path / "zenoh.json5"
    path.write_text("{ connect: { timeout_ms: -1 } }")
    options = BusOptions(
        mode="client", connect=(free_endpoint(),), config_file=path, open_timeout_s=0.05
    )
    with pytest.raises(BusError, match="did not open within"):
        await Bus(options).open()


async def test_nothing_of_a_closed_bus_stays():
    before = {thread.name for thread in threading.enumerate()}
    descriptors = []
    # Reserving a port takes a descriptor of its own.
    options = BusOptions(
        listen=(free_endpoint(),), connect=(free_endpoint(),), close_timeout_s=PATIENCE_S
    )
    for _ in range(3):
        bus = Bus(options)
        await bus.open()
        bus.subscribe(keys.CMD_VEL, lambda batch: None)
        bus.serve(keys.ESTOP, lambda _: Response(payload=b""), fallback=refusal)
        bus.publisher(keys.EVENTS).put(b"x")
        assert await bus.close()
        assert await bus.close()
        await eventually(lambda: {thread.name for thread in threading.enumerate()} <= before)
        await eventually(lambda: listening_addresses() == [])
        descriptors.append(len(os.listdir("/proc/self/fd")))
    # The first time Zenoh starts threads that stay, with descriptors of theirs.
    await eventually(lambda: len(os.listdir("/proc/self/fd")) <= descriptors[1])


PROGRAM = """
import asyncio, sys
from yahboomd.core.bus.options import BusOptions
from yahboomd.core.bus.services import Response, Service
from yahboomd.core.bus.bus import Bus

async def main():
    options = BusOptions(
        listen=(sys.argv[1],), connect=(sys.argv[2],), open_timeout_s=60.0, close_timeout_s=60.0
    )
    async with Bus(options) as bus:
        bus.subscribe("cmd_vel", print)
        bus.token("yahboomd/alive")
        bus.serve("yahboomd/board", lambda r: Response(payload=b""), fallback=print)
        bus.publisher("yahboomd/events").put(b"x")
        bus.publisher("tf_static", cache=1).put(b"x")
        if sys.argv[3] == "fail":
            raise SystemExit(7)

asyncio.run(main())
"""


@pytest.mark.parametrize(
    ("how", "status"), [pytest.param("well", 0, marks=pytest.mark.nightly), ("fail", 7)]
)
async def test_the_process_ends_after_the_bus_was_closed(how, status, zenoh_router):
    zenoh_router.start()
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-W", "error", "-c", PROGRAM, free_endpoint(), zenoh_router.endpoint, how,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    try:
        out, err = await process.communicate()
    finally:
        if process.returncode is None:
            process.kill()
    assert (process.returncode, out, err) == (status, b"", b"")


async def test_close_that_does_not_end_in_time_is_reported(caplog):
    bus = Bus(BusOptions(listen=(free_endpoint(),), connect=(), close_timeout_s=0.0))
    await bus.open()
    assert not await bus.close()
    assert "did not close" in caplog.text
    await eventually(lambda: not any(t.name == "bus-close" for t in threading.enumerate()))


async def test_150_silent_connections_keep_no_client_out(bus, zenoh_app):
    host, _, port = bus.options.listen[0].removeprefix("tcp/").partition(":")
    silent = [socket.create_connection((host, int(port))) for _ in range(150)]
    try:
        app = zenoh_app("client", bus.options.listen[0])
        await eventually(lambda: str(app.session.zid()) in {n.zid for n in bus.neighbours})
        # They do not hold their places for long.
        await eventually(lambda: all(_ended(each) for each in silent))
    finally:
        for each in silent:
            each.close()


def _ended(connection):
    connection.setblocking(False)
    try:
        return connection.recv(1) == b""
    except BlockingIOError:
        return False
    except ConnectionError:
        return True


def failure(options):
    with pytest.raises(zenoh.ZError) as caught:
        zenoh.open(zenoh_config(options))
    error = open_failure(caught.value, options)
    assert isinstance(error, BusError)
    assert ".rs:" not in str(error)
    return error


def test_an_address_in_use_is_reported_with_its_holder_and_the_remedy():
    with socket.create_server(("127.0.0.1", 0)) as listening:
        endpoint = f"tcp/127.0.0.1:{listening.getsockname()[1]}"
        error = failure(BusOptions(listen=(endpoint,), connect=()))
    assert endpoint in error.message
    assert f"({os.getpid()}) listens there already" in error.message
    assert "zenoh.listen" in error.remedy


def test_an_address_of_another_machine_is_reported():
    error = failure(BusOptions(listen=("tcp/192.0.2.1:7448",), connect=()))
    assert "no address tcp/192.0.2.1:7448" in error.message


async def test_a_missing_router_is_reported_to_a_client():
    endpoint = free_endpoint()
    with pytest.raises(BusError, match=f"No Zenoh router answers at {endpoint}") as caught:
        await Bus(BusOptions(mode="client", connect=(endpoint,))).open()
    assert "'router'" in caught.value.remedy


def test_a_socket_in_a_missing_folder_is_reported(tmp_path):
    path = tmp_path / "missing" / "bus.sock"
    error = failure(BusOptions(listen=(f"unixsock-stream/{path}",), connect=()))
    assert str(path) in error.message
    assert "folder" in error.remedy


def test_tls_without_certificates_is_reported():
    endpoint = free_endpoint().replace("tcp", "tls")
    error = failure(BusOptions(listen=(endpoint,), connect=()))
    assert "TLS" in error.message
    assert error.exit_code == os.EX_CONFIG


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


async def test_what_was_put_before_a_router_came_reaches_who_looks_later(zenoh_router, zenoh_app):
    options = BusOptions(listen=(free_endpoint(),), connect=(zenoh_router.endpoint,))
    async with Bus(options) as bus:
        bus.publisher("tf_static", cache=1).put(b"static frames")
        zenoh_router.start()
        await eventually(lambda: bus.neighbours)
        app = zenoh_app("client", zenoh_router.endpoint)
        with late_subscriber(app.session, "tf_static") as heard:
            assert (await eventually(lambda: heard))[0].payload == b"static frames"


PATIENT = """
{transport: {link: {tx: {queue: {congestion_control: {block: {wait_before_close: 3600000000}}}}}}}
"""


async def test_a_frozen_subscriber_holds_up_neither_put_nor_the_others(zenoh_app, tmp_path):
    # Were it waited for, the loop would stand still for an hour.
    config = tmp_path / "zenoh.json5"
    config.write_text(PATIENT)
    options = BusOptions(
        listen=(free_endpoint(),), connect=(), namespace="bot1", config_file=config
    )
    async with Bus(options) as bus:
        publisher = bus.publisher(keys.POSE)
        script = Path(__file__).with_name("zenoh_listener_process.py")
        frozen = await asyncio.to_thread(
            subprocess.Popen,
            [sys.executable, str(script), bus.options.listen[0], "bot1/**"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        try:
            assert await asyncio.to_thread(frozen.stdout.readline) == b"ready\n"
            samples = zenoh_app("client", bus.options.listen[0]).collect("bot1/yahboomd/pose")
            await eventually(lambda: publisher.has_subscribers and len(bus.neighbours) == 2)
            frozen.send_signal(signal.SIGSTOP)
            # Far more than the buffers on the way to the frozen one hold.
            for number in range(300):
                assert publisher.put(b"%6d" % number * 10_000)
                await asyncio.sleep(0)
            assert publisher.counters.puts == 300
            await eventually(
                lambda: publisher.put(b"last") and samples and samples[-1].payload == b"last"
            )
        finally:
            frozen.kill()
            frozen.communicate()


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


@pytest.mark.nightly
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
