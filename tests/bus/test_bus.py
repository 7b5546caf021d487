import asyncio
import json
import os
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest
import zenoh
from zenoh_fixtures import PATIENCE_S, eventually, free_endpoint

from yahboomd.core.bus import keys
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.options import BusOptions
from yahboomd.core.bus.services import Response, Service
from yahboomd.core.errors import BusError

pytestmark = pytest.mark.realtime


def refusal(reason, _request):
    return Response(payload=reason.encode())


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


@pytest.mark.parametrize("mode", ["client", "peer"])
async def test_applications_reach_the_robot_directly(robot, zenoh_app, mode):
    await exercise(robot, zenoh_app(mode, robot.options.listen[0]))


@pytest.mark.parametrize("mode", ["client", "peer"])
async def test_applications_reach_the_robot_through_a_router_that_comes_later(
    robot, zenoh_router, zenoh_app, mode
):
    zenoh_router.start()
    (router,) = await eventually(lambda: routers(robot))
    assert router.address == zenoh_router.endpoint
    await exercise(robot, zenoh_app(mode, zenoh_router.endpoint))


@pytest.mark.parametrize("mode", ["client", "peer"])
async def test_applications_reach_the_robot_through_a_router_that_was_there_first(
    zenoh_router, zenoh_app, mode
):
    zenoh_router.start()
    app = zenoh_app(mode, zenoh_router.endpoint)
    options = BusOptions(listen=(free_endpoint(),), connect=(zenoh_router.endpoint,))
    async with Bus(options) as bus:
        await exercise(bus, app)


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


async def test_two_robots_tell_each_other_apart_on_one_router(zenoh_router):
    zenoh_router.start()
    alive = [[], []]
    buses = [
        Bus(BusOptions(listen=(free_endpoint(),), connect=(zenoh_router.endpoint,)))
        for _ in range(2)
    ]
    async with buses[0], buses[1]:
        for bus, seen in zip(buses, alive, strict=True):
            bus.token(keys.holder_key(keys.ALIVE, bus.zid))
            bus.watch_tokens(f"{keys.ALIVE}/*", seen.extend)
        both = {keys.holder_key(keys.ALIVE, bus.zid) for bus in buses}
        for seen in alive:
            await eventually(lambda seen=seen: {change.key for change in seen} == both)


async def test_an_application_reaches_the_robot_by_a_unix_socket(zenoh_app, tmp_path):
    options = BusOptions(listen=(), connect=(), unix_socket=tmp_path / "bus.sock")
    async with Bus(options) as bus:
        await exercise(bus, zenoh_app("client", f"unixsock-stream/{tmp_path}/bus.sock"))


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


async def test_opening_twice_on_one_port_names_the_holder(robot):
    with pytest.raises(BusError, match=rf"\({os.getpid()}\) listens there already"):
        await Bus(BusOptions(listen=robot.options.listen, connect=())).open()


async def test_a_client_without_its_router_fails_to_open():
    endpoint = free_endpoint()
    with pytest.raises(BusError, match="No Zenoh router answers"):
        await Bus(BusOptions(mode="client", connect=(endpoint,))).open()


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


async def test_a_bus_that_is_not_open_says_so():
    bus = Bus(BusOptions())
    with pytest.raises(BusError, match="not open"):
        bus.subscribe(keys.CMD_VEL, lambda batch: None)
    with pytest.raises(BusError, match="not open"):
        bus.publisher(keys.POSE)


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


@pytest.mark.parametrize(("how", "status"), [("well", 0), ("fail", 7)])
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


def openssl(folder, *arguments):
    subprocess.run(["openssl", *arguments], cwd=folder, check=True, capture_output=True)


@pytest.fixture(scope="module")
def certificates(tmp_path_factory):
    """An authority and a certificate for localhost, made here."""
    folder = tmp_path_factory.mktemp("certificates")
    key = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")
    openssl(folder, "req", "-x509", *key, "-keyout", "ca.key", "-out", "ca.pem", "-days", "2",
            "-subj", "/CN=test authority")  # fmt: skip
    openssl(folder, "req", *key, "-keyout", "robot.key", "-out", "robot.csr",
            "-subj", "/CN=localhost")  # fmt: skip
    (folder / "san").write_text("subjectAltName=DNS:localhost,IP:127.0.0.1")
    openssl(folder, "x509", "-req", "-in", "robot.csr", "-CA", "ca.pem", "-CAkey", "ca.key",
            "-CAcreateserial", "-out", "robot.pem", "-days", "2", "-extfile", "san")  # fmt: skip
    return folder


@pytest.fixture
def guarded(certificates, tmp_path):
    """Options of a robot that asks for TLS, a password, and the right to a key."""
    (tmp_path / "users").write_text("operator:secret1\nviewer:secret2\n")
    settings = json.loads(zenoh.Config.from_file(str(EXAMPLE)).get_json("access_control"))
    path = tmp_path / "zenoh.json5"
    path.write_text(
        json.dumps(
            {
                "access_control": settings,
                "transport": {
                    "auth": {
                        "usrpwd": {
                            "user": "robot",
                            "password": "secret0",
                            "dictionary_file": str(tmp_path / "users"),
                        }
                    },
                    "link": {
                        "tls": {
                            "listen_certificate": str(certificates / "robot.pem"),
                            "listen_private_key": str(certificates / "robot.key"),
                        }
                    },
                },
            }
        )
    )
    port = free_endpoint().rpartition(":")[2]
    return BusOptions(listen=(f"tls/localhost:{port}",), connect=(), config_file=path)


EXAMPLE = Path(__file__).parents[2] / "examples" / "zenoh-acl.json5"


def credentials(certificates, user, password):
    return {
        "transport/link/tls/root_ca_certificate": str(certificates / "ca.pem"),
        "transport/auth/usrpwd/user": user,
        "transport/auth/usrpwd/password": password,
    }


async def test_who_may_not_drive_may_still_watch(guarded, certificates, zenoh_app):
    async with Bus(guarded) as bus:
        commands = []
        bus.subscribe(keys.CMD_VEL, commands.extend)
        bus.serve(keys.ESTOP_RESET, lambda _: Response(payload=b"released"), fallback=refusal)
        bus.serve(keys.ESTOP, lambda _: Response(payload=b"engaged"), fallback=refusal)
        pose = bus.publisher(keys.POSE)
        endpoint = guarded.listen[0]
        viewer = zenoh_app("client", endpoint, credentials(certificates, "viewer", "secret2"))
        operator = zenoh_app("client", endpoint, credentials(certificates, "operator", "secret1"))

        poses = viewer.collect("yahboomd/pose")
        await eventually(lambda: pose.put(b"pose") and poses)

        await operator.reach("cmd_vel")
        viewer.session.put("cmd_vel", b"from the viewer")
        # The viewer's query is not let through. It uses the same connection, in order, so its end
        # shows that the command would have arrived by now.
        assert await viewer.ask("yahboomd/estop/reset") == []
        operator.session.put("cmd_vel", b"from the operator")
        await eventually(lambda: commands)
        assert [command.payload for command in commands] == [b"from the operator"]

        (reply,) = await operator.ask("yahboomd/estop/reset")
        assert reply.ok.payload.to_bytes() == b"released"
        (reply,) = await viewer.ask("yahboomd/estop")
        assert reply.ok.payload.to_bytes() == b"engaged"


async def test_a_wrong_password_is_let_in_nowhere(guarded, certificates, zenoh_app):
    async with Bus(guarded):
        for user, password in (("viewer", "wrong"), ("stranger", "secret2")):
            with pytest.raises(zenoh.ZError):
                zenoh_app("client", guarded.listen[0], credentials(certificates, user, password))


async def test_plain_tcp_gets_nothing_from_a_robot_with_tls(guarded, zenoh_app):
    async with Bus(guarded):
        plain = guarded.listen[0].replace("tls/localhost", "tcp/127.0.0.1")
        with pytest.raises(zenoh.ZError):
            await asyncio.to_thread(
                zenoh_app, "client", plain, {"transport/unicast/open_timeout": 500}
            )


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


async def test_what_is_refused_lost_or_failed_on_the_bus_is_counted(bus, zenoh_app):
    app = zenoh_app("client", bus.options.listen[0])
    pose = bus.publisher(keys.POSE)
    arrivals = []
    bus.subscribe(keys.CMD_VEL, arrivals.extend, max_bytes=8)
    bus.serve(keys.CONFIG, lambda r: Response(payload=b"here"), fallback=refusal)
    bus.serve(keys.BOARD, lambda r: 1 / 0, fallback=refusal, max_bytes=8)
    pose.put(b"{}")
    await app.reach("bot1/cmd_vel")
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
