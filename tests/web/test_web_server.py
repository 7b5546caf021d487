"""The server's sockets: limits of connections, TLS, readers that do not read."""

from __future__ import annotations

import asyncio
import json
import os
import socket
import ssl
from pathlib import Path
from typing import Any

import pytest
from web_site import ZERO
from zenoh_fixtures import PATIENCE_S, eventually, free_endpoint

from yahboomd.cli.process_limits import allow_files
from yahboomd.core.errors import ConfigError, ListenError
from yahboomd.web import web_server
from yahboomd.web.certificate import Certificate, make_certificate
from yahboomd.web.web_server import FILES, MAX_OPEN, CountedConnection, listen

pytestmark = pytest.mark.realtime


async def test_the_estop_is_served_beside_a_thousand_connections_that_say_nothing(
    fake_daemon: Any, site: Any
) -> None:
    allow_files(FILES, who="the test")
    daemon = await fake_daemon()
    served = await site(daemon)
    page = await served.driver()
    idle = [socket.create_connection(("127.0.0.1", served.port)) for _ in range(1000)]
    try:
        await eventually(lambda: len(CountedConnection.waiting) == MAX_OPEN)
        status, _, body = await served.request("POST", "/estop")
        assert (status, json.loads(body)["engaged"]) == (200, True)
        await page.press(lambda: daemon.velocities)
        await served.page()
        assert len(CountedConnection.waiting) <= MAX_OPEN
    finally:
        for each in idle:
            each.close()


@pytest.mark.nightly
async def test_connections_whose_tls_never_begins_are_bounded_and_the_estop_is_served(
    fake_daemon: Any, site: Any, tmp_path: Path
) -> None:
    """Each takes 300 kB: a thousand of them ended a service that may have 256 MB."""
    allow_files(FILES, who="the test")
    daemon = await fake_daemon()
    certificate, key, _ = make_certificate(tmp_path, ["127.0.0.1"])
    served = await site(daemon, context=Certificate(certificate=certificate, key=key).context())
    idle = [socket.create_connection(("127.0.0.1", served.port)) for _ in range(500)]
    try:
        await eventually(lambda: len(CountedConnection.waiting) == MAX_OPEN)
        page = await served.page(ssl=ssl.create_default_context(cafile=str(certificate)))
        await page.send(type="estop", id=1)
        assert (await page.one("answer", id=1))["ok"]
        assert len(CountedConnection.waiting) <= MAX_OPEN
        # Those of the test itself among them.
        most = len(idle) + MAX_OPEN + 100
        await eventually(lambda: len(list(Path("/proc/self/fd").iterdir())) < most)
    finally:
        for each in idle:
            each.close()


async def test_a_connection_that_sends_no_request_in_time_is_closed(
    site: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(web_server, "WAIT_S", 0.05)
    served = await site(endpoint=free_endpoint())
    for begun in (b"", b"GET / HTTP/1.1\r\nHost: 127."):
        reader, writer = await asyncio.open_connection("127.0.0.1", served.port)
        writer.write(begun)
        assert await reader.read() == b""
        writer.close()


def handshake(served: Any) -> bytes:
    return (
        f"GET /ws HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\nOrigin: {served.origin}\r\n"
        "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n\r\n"
    ).encode()


async def test_a_request_that_becomes_no_page_is_answered_and_its_connection_closed(
    site: Any,
) -> None:
    """Such connections were not counted, had no deadline, and took every open file."""
    served = await site(endpoint=free_endpoint())
    for more in (b"Content-Length: 5\r\n", b"Transfer-Encoding: chunked\r\n", b"A: b\r\n" * 200):
        request = handshake(served).removesuffix(b"\r\n") + more + b"\r\n"
        async with asyncio.timeout(PATIENCE_S):
            status, headers, _ = await served.raw(request)
        assert (status, headers["x-frame-options"]) == (400, "DENY")


def flooding_page(served: Any, limit: int = socket.SO_SNDBUF, size: int = 4096) -> socket.socket:
    """A page in full flood; what it may send, or has to read, is short."""
    flooding = socket.socket()
    flooding.setsockopt(socket.SOL_SOCKET, limit, size)
    flooding.connect(("127.0.0.1", served.port))
    flooding.sendall(handshake(served))
    flooding.setblocking(False)
    return flooding


@pytest.mark.nightly
async def test_a_page_that_pings_without_end_and_reads_no_answer_is_cut_off(site: Any) -> None:
    served = await site(endpoint=free_endpoint())
    flooding = flooding_page(served, socket.SO_RCVBUF, 2048)
    ping = b"\x89\xfd\0\0\0\0" + b"p" * 125
    loop = asyncio.get_running_loop()
    try:
        with pytest.raises(ConnectionError):  # noqa: PT012
            while True:
                await loop.sock_sendall(flooding, ping * 100)
        await eventually(lambda: not served.hub._pages)
    finally:
        flooding.close()


@pytest.mark.parametrize(
    "frame",
    [
        pytest.param(b"\x89\x80\0\0\0\0", id="ping", marks=pytest.mark.nightly),
        pytest.param(b"\x8a\x80\0\0\0\0", id="pong", marks=pytest.mark.nightly),
        pytest.param(b"\x00\x80\0\0\0\0", id="piece"),
    ],
)
async def test_a_page_that_floods_with_frames_that_no_page_sends_is_cut_off(
    fake_daemon: Any, site: Any, frame: bytes
) -> None:
    daemon = await fake_daemon()
    served = await site(daemon)
    loop = asyncio.get_running_loop()
    flooding = flooding_page(served)
    # Empty, so that no limit of bytes is reached: the first piece of a message, and then more.
    begun = b"" if frame[0] & 0x80 else b"\x01\x80\0\0\0\0"
    try:
        await eventually(lambda: served.hub._pages)

        async def flood() -> None:
            await loop.sock_sendall(flooding, begun + frame * 20)
            while True:
                await loop.sock_sendall(flooding, frame * 100)

        async def read() -> None:
            while await loop.sock_recv(flooding, 1 << 16):
                pass

        reading = asyncio.create_task(read())
        with pytest.raises(ConnectionError):
            await flood()
        await eventually(lambda: not served.hub._pages)
        reading.cancel()
        await asyncio.gather(reading, return_exceptions=True)
    finally:
        flooding.close()
    status, _, body = await served.request("POST", "/estop")
    assert (status, json.loads(body)["engaged"]) == (200, True)


@pytest.mark.nightly
async def test_a_page_that_floods_with_emergency_stops_delays_no_other_page(
    fake_daemon: Any, site: Any
) -> None:
    daemon = await fake_daemon()
    served = await site(daemon)
    stop = b'{"type":"estop"}'
    frame = bytes((0x81, 0x80 | len(stop), 0, 0, 0, 0)) + stop
    flooding = flooding_page(served)
    await eventually(lambda: served.hub._pages)
    flood = asyncio.get_running_loop().sock_sendall(flooding, frame * 100_000)
    sending = asyncio.create_task(flood)
    try:
        await eventually(lambda: daemon.asked)
        for _ in range(10):
            status, _, body = await served.request("POST", "/estop")
            assert (status, json.loads(body)["engaged"]) == (200, True)
        # It waits for its turn, with most of them.
        assert not sending.done()
    finally:
        sending.cancel()
        flooding.close()
        await asyncio.gather(sending, return_exceptions=True)


async def test_a_page_that_stops_reading_delays_no_other_and_gets_no_old_samples(
    fake_daemon: Any, site: Any
) -> None:
    daemon = await fake_daemon()
    served = await site(daemon)
    slow = flooding_page(served, socket.SO_RCVBUF, 2048)
    try:
        page = await served.driver()
        await page.press(lambda: len(daemon.velocities) > 10)
        begun, looks = len(page.of("beat")), 0

        def given_up() -> bool:
            nonlocal looks
            looks += 1
            return len(served.hub._pages) == 1

        # Written on until it takes no more: then given up after five seconds.
        await eventually(given_up)
        # A beat comes every 50 ms, and a look is taken every 10 ms, if this machine has time.
        assert len(page.of("beat")) > begun + looks / 8
    finally:
        slow.close()


async def test_tls_serves_the_page_and_its_cookie_travels_over_it_alone(
    fake_daemon: Any, site: Any, tmp_path: Path
) -> None:
    daemon = await fake_daemon()
    certificate, key, _ = make_certificate(tmp_path, ["127.0.0.1", "localhost"])
    context = Certificate(certificate=certificate, key=key).context()
    served = await site(daemon, phones=True, context=context)
    trusting = ssl.create_default_context(cafile=str(certificate))
    page = await served.driver(ssl=trusting)
    await page.press(lambda: daemon.velocities)
    page.socket.transport.abort()
    await eventually(lambda: daemon.velocities[-1] == ZERO)
    reader, writer = await asyncio.open_connection("127.0.0.1", served.port, ssl=trusting)
    body = json.dumps({"token": served.link()})
    writer.write(
        f"POST /session HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\nOrigin: {served.origin}\r\n"
        f"Content-Length: {len(body)}\r\nConnection: close\r\n\r\n{body}".encode()
    )
    answer = (await reader.read()).decode().lower()
    writer.close()
    await writer.wait_closed()
    assert " 204 " in answer
    assert "; secure" in answer


def test_a_port_that_is_taken_is_named_with_what_to_do() -> None:
    with listen("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(ListenError, match=rf"port {port}: Address already in use.*--listen"):
            listen("127.0.0.1", port)
    with pytest.raises(ListenError, match=r"192\.0\.2\.1"):
        listen("192.0.2.1", 8480)


def test_a_certificate_that_cannot_be_used_is_named_with_what_to_do(tmp_path: Path) -> None:
    certificate, key, _ = make_certificate(tmp_path, ["127.0.0.1"])
    with pytest.raises(ConfigError, match=r"nothing\.pem cannot be read: No such file"):
        Certificate(certificate=tmp_path / "nothing.pem", key=key).context()
    with pytest.raises(ConfigError, match=r"not a certificate and its key.*--make-certificate"):
        Certificate(certificate=key, key=certificate).context()
    other = tmp_path / "other"
    _, foreign, _ = make_certificate(other, ["127.0.0.1"])
    with pytest.raises(ConfigError, match=r"not a certificate and its key"):
        Certificate(certificate=certificate, key=foreign).context()
    pipe = tmp_path / "pipe.pem"
    os.mkfifo(pipe)
    with pytest.raises(ConfigError, match=r"pipe\.pem cannot be read: it is no ordinary file"):
        Certificate(certificate=pipe, key=key).context()
