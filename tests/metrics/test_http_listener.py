from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator
from contextlib import suppress
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from zenoh_fixtures import eventually

from yahboomd.core.errors import ListenError
from yahboomd.tools.metrics import http_listener
from yahboomd.tools.metrics.http_listener import (
    MAX_HEAD,
    MAX_OPEN,
    OUTCOMES,
    MetricsListener,
    Place,
)

LOCAL = Place(host="127.0.0.1", port=0)
PAGE = "up 1\n"


@pytest.fixture
async def listener() -> AsyncIterator[MetricsListener]:
    async with MetricsListener(
        LOCAL, lambda openmetrics: f"{openmetrics}\n{PAGE}", names=["robot.local"]
    ) as made:
        yield made


async def connect(listener: MetricsListener) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    return await asyncio.open_connection(listener.place.host, listener.place.port)


async def sent(listener: MetricsListener, request: bytes) -> tuple[int, str, str]:
    """The answer to these bytes: status, header, body."""
    reader, writer = await connect(listener)
    writer.write(request)
    answer = (await reader.read()).decode()
    writer.close()
    head, _, body = answer.partition("\r\n\r\n")
    return int(head.split()[1]), head, body


async def asked(
    listener: MetricsListener, target: str = "/metrics", *, method: str = "GET", **headers: str
) -> tuple[int, str, str]:
    """The answer to a proper request."""
    lines = [f"{method} {target} HTTP/1.1"]
    lines += [f"{name}: {value}" for name, value in {"Host": "127.0.0.1:1", **headers}.items()]
    return await sent(listener, "\r\n".join([*lines, "", ""]).encode())


async def disconnected(reader: asyncio.StreamReader) -> None:
    """Wait until the listener has closed the connection, without an answer."""
    with suppress(ConnectionError):
        assert await reader.read() == b""


def counted(listener: MetricsListener) -> dict[str, int]:
    return {outcome: count for outcome, count in listener.outcomes.items() if count}


async def test_a_scraper_gets_the_page_in_the_format_that_it_asks_for(
    listener: MetricsListener,
) -> None:
    status, head, body = await asked(listener, Accept="application/openmetrics-text; version=1.0.0")
    assert (status, body) == (200, f"True\n{PAGE}")
    assert "Content-Type: application/openmetrics-text; version=1.0.0; charset=utf-8" in head
    status, head, body = await asked(listener, "/metrics?x=1")
    assert (status, body) == (200, f"False\n{PAGE}")
    assert "Content-Type: text/plain; version=0.0.4; charset=utf-8" in head
    assert "Access-Control" not in head
    assert counted(listener) == {"answered": 2}


async def test_head_has_no_body(listener: MetricsListener) -> None:
    status, head, body = await asked(listener, method="HEAD")
    assert (status, body) == (200, "")
    assert f"Content-Length: {len(PAGE) + 6}" in head


@pytest.mark.parametrize(
    "host",
    [
        *("127.0.0.1", "127.0.0.1:9448", "[::1]:9448", "localhost:9448", "LOCALHOST", "10.0.0.5"),
        *("robot.local:9448", "Robot.Local."),
    ],
)  # fmt: skip
async def test_addresses_localhost_and_allowed_names_may_be_asked(
    listener: MetricsListener, host: str
) -> None:
    assert (await asked(listener, Host=host))[0] == 200


@pytest.mark.parametrize(
    "host",
    [
        *("evil.example", "evil.example:9448", "127.0.0.1.evil.example", "localhost.evil.example"),
        *("x y", "", "127.0.0.1@evil.example", "robot.local.evil", "[::1", "2130706433"),
    ],
)  # fmt: skip
async def test_a_name_that_a_website_made_point_here_is_refused(
    listener: MetricsListener, host: str
) -> None:
    status, _, body = await asked(listener, Host=host)
    assert status == 421
    assert "--host-name" in body
    assert PAGE not in body
    assert counted(listener) == {"bad_host": 1}


@pytest.mark.parametrize(
    ("target", "method", "status", "outcome"),
    [
        ("/", "GET", 404, "bad_path"),
        ("/metrics/", "GET", 404, "bad_path"),
        ("/../etc/passwd", "GET", 404, "bad_path"),
        ("/metrics", "POST", 405, "bad_method"),
        ("/metrics", "OPTIONS", 405, "bad_method"),
    ],
)
async def test_there_is_one_page_and_it_can_only_be_read(
    listener: MetricsListener, target: str, method: str, status: int, outcome: str
) -> None:
    answered, _, body = await asked(listener, target, method=method)
    assert answered == status
    assert PAGE not in body
    assert counted(listener) == {outcome: 1}


@pytest.mark.parametrize(
    "request_",
    [
        b"GET /metrics HTTP/1.1\r\n\r\n",
        b"GET /metrics HTTP/1.1\r\nHost: localhost\r\nHost: evil\r\n\r\n",
        b"GET /metrics\r\nHost: localhost\r\n\r\n",
        b"GET http://localhost/metrics HTTP/2\r\nHost: localhost\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\r\n\r\n",
        b"GET /metrics HTTP/1.1\r\nHost: localhost\r\nX: " + b"x" * MAX_HEAD + b"\r\n\r\n",
    ],
)
async def test_what_is_no_request_gets_an_answer_in_words(
    listener: MetricsListener, request_: bytes
) -> None:
    status, _, body = await sent(listener, request_)
    assert status == 400
    assert body
    assert counted(listener) == {"bad_request": 1}


@given(head=st.binary(max_size=200), host=st.text(max_size=30))
def test_no_bytes_break_it_and_none_but_good_requests_get_the_page(head: bytes, host: str) -> None:
    listener = MetricsListener(LOCAL, lambda _: PAGE)
    for request in (head, f"GET /metrics HTTP/1.1\r\nHost: {host}\r\n\r\n".encode()):
        outcome, answer = listener._answer(request)
        assert (outcome == "answered") is answer.startswith(b"HTTP/1.1 200 ")
        assert outcome != "answered" or request is not head


async def test_who_asks_nothing_is_disconnected(
    listener: MetricsListener, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(http_listener, "READ_S", 0.05)
    reader, writer = await connect(listener)
    writer.write(b"GET /metrics HTT")
    await disconnected(reader)
    writer.close()
    assert counted(listener) == {"too_slow": 1}


async def test_who_does_not_read_the_answer_is_disconnected_and_holds_up_no_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(http_listener, "WRITE_S", 0.3)
    large = "x" * 50_000_000
    async with MetricsListener(LOCAL, lambda openmetrics: large if openmetrics else PAGE) as made:
        _, slow = await connect(made)
        slow.write(
            b"GET /metrics HTTP/1.1\r\nHost: localhost\r\nAccept: application/openmetrics-text"
        )
        slow.write(b"\r\n\r\n")
        slow.transport.pause_reading()  # type: ignore[attr-defined]
        assert (await asked(made))[2] == PAGE
        await eventually(lambda: made.outcomes["too_slow"])
        slow.close()
    assert counted(made) == {"answered": 1, "too_slow": 1}


async def test_one_connection_too_many_closes_the_oldest(listener: MetricsListener) -> None:
    silent = [await connect(listener) for _ in range(MAX_OPEN)]
    assert (await asked(listener))[0] == 200
    assert counted(listener) == {"answered": 1, "crowded_out": 1}
    await disconnected(silent[0][0])
    for _, writer in silent:
        writer.close()
    await eventually(lambda: listener.outcomes["gone"] == MAX_OPEN - 1)


async def test_a_page_that_cannot_be_made_leaves_no_connection_open() -> None:
    def fails(openmetrics: bool) -> str:
        raise ZeroDivisionError

    seen: list[dict[str, Any]] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, context: seen.append(context))
    async with MetricsListener(LOCAL, fails) as made:
        reader, writer = await connect(made)
        writer.write(b"GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n")
        await disconnected(reader)
        writer.close()
        assert counted(made) == {"gone": 1}
    assert seen


async def test_a_port_that_is_taken_is_said_with_the_way_out() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        place = Place(host="127.0.0.1", port=taken.getsockname()[1])
        with pytest.raises(ListenError, match="--listen") as refused:
            async with MetricsListener(place, lambda _: PAGE):
                pass
    assert "in use" in str(refused.value)
    assert refused.value.exit_code == 69


@pytest.mark.parametrize(
    ("text", "host", "loopback"),
    [
        ("127.0.0.1:9448", "127.0.0.1", True),
        ("127.1.2.3:9448", "127.1.2.3", True),
        ("[::1]:9448", "::1", True),
        ("localhost:9448", "127.0.0.1", True),
        ("0.0.0.0:9448", "0.0.0.0", False),
        ("[::]:9448", "::", False),
        ("192.168.1.5:9448", "192.168.1.5", False),
    ],
)
def test_a_place_is_an_address_and_a_port(text: str, host: str, loopback: bool) -> None:
    assert Place.of(text) == Place(host=host, port=9448)
    assert Place(host=host, port=9448).is_loopback is loopback


@pytest.mark.parametrize("text", ["", "9448", "127.0.0.1", "robot.local:9448", "127.0.0.1:99999"])
def test_all_else_is_no_place(text: str) -> None:
    assert Place.of(text) is None


async def test_every_outcome_is_counted_from_the_start(listener: MetricsListener) -> None:
    assert set(listener.outcomes) == set(OUTCOMES)
