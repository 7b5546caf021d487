"""Who gets in, and how: tokens, cookies, Host and Origin, on real sockets."""

from __future__ import annotations

import asyncio
import json
import logging
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import InvalidStatus
from zenoh_fixtures import eventually, free_endpoint

from yahboomd.web.web_application import HEADERS

pytestmark = pytest.mark.realtime


def login(token: str) -> bytes:
    return json.dumps({"token": token}).encode()


async def test_a_foreign_host_is_refused_everywhere(site: Any) -> None:
    """DNS rebinding: the name of any website may point at this machine."""
    served = await site(endpoint=free_endpoint())
    for host in ("evil.example", "", "127.0.0.1.evil.example:80", "192.0.2.1"):
        for method, path in (("GET", "/"), ("GET", "/session"), ("POST", "/estop")):
            status, headers, body = await served.request(
                method, path, Host=host, Origin=f"http://{host}"
            )
            # Without any Host it is no request of HTTP/1.1.
            assert status == (421 if host else 400)
            if host:
                assert b"--host-name" in body
                assert headers["x-frame-options"] == "DENY"
        if not host:
            continue
        handshake = (
            f"GET /ws HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\nUpgrade: websocket\r\n"
            "Connection: Upgrade\r\nSec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n"
            "Sec-WebSocket-Version: 13\r\n\r\n"
        )
        assert (await served.raw(handshake.encode()))[0] == 421


async def test_a_foreign_origin_is_refused_for_all_that_changes_anything(
    fake_daemon: Any, site: Any
) -> None:
    daemon = await fake_daemon()
    served = await site(daemon, phones=True)
    number = served.sessions.all[0].id if served.cookie() else ""
    for origin in ("http://evil.example", "null", "http://127.0.0.1:1", ""):
        for path in ("/estop", "/session", "/session/name", f"/sessions/{number}/end"):
            status, _, _ = await served.request(
                "POST", path, login(served.link()), Origin=origin, **served.cookie()
            )
            assert status == 403
        with pytest.raises(InvalidStatus, match="403"):
            await served.open(origin=origin or None, additional_headers=served.cookie())
        for path in ("/", "/sessions") if origin else ():
            assert (await served.request("GET", path, Origin=origin, **served.cookie()))[0] == 403
    assert [each.id for each in served.sessions.all] == [number]
    assert daemon.asked == []


async def test_every_answer_forbids_frames_foreign_scripts_and_referrers(site: Any) -> None:
    served = await site(endpoint=free_endpoint(), phones=True)
    for method, path in (
        *(("GET", "/"), ("GET", "/page/nothing.js"), ("GET", "/nothing"), ("GET", "/session")),
        *(("POST", "/session"), ("POST", "/estop"), ("DELETE", "/")),
    ):
        _, headers, _ = await served.request(method, path)
        assert {name: headers.get(name) for name in HEADERS} == HEADERS, path
        assert "server" not in headers
    for nonsense in (
        b"nonsense\r\n\r\n",
        b"GET /  HTTP/1.1 x\r\n\r\n",
        b"\x16\x03\x01\x00\r\n\r\n",
    ):
        status, headers, _ = await served.raw(nonsense)
        assert status == 400
        assert {name: headers.get(name) for name in HEADERS} == HEADERS, nonsense
    policy = HEADERS["content-security-policy"]
    assert "frame-ancestors 'none'" in policy
    assert "unsafe" not in policy
    assert "http" not in policy


async def test_no_path_leads_out_of_the_page(site: Any) -> None:
    served = await site(endpoint=free_endpoint())
    for path in (
        *("/page/../session_files.py", "/page/..%2f..%2fprogram.py", "/page/%2e%2e/page_hub.py"),
        *("/page//etc/passwd", "/page/....//beats.py", "/..%5cweb_server.py", "/page/", "/page"),
        *("/page/%00", "//etc/passwd", "/page/../../../../../../etc/passwd"),
    ):
        status, _, body = await served.request("GET", path)
        assert status in {307, 400, 404}, path
        assert b"import" not in body, path
        assert b"root:" not in body, path


async def test_bodies_and_headers_are_bounded_in_size(site: Any) -> None:
    served = await site(endpoint=free_endpoint(), phones=True)
    assert (await served.request("POST", "/session", b"x" * 2049))[0] == 413
    chunked = (
        (
            f"POST /session HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\n"
            f"Origin: {served.origin}\r\n"
            "Transfer-Encoding: chunked\r\nConnection: close\r\n\r\n"
        ).encode()
        + b"800\r\n"
        + b"x" * 2048
        + b"\r\n800\r\n"
        + b"x" * 2048
        + b"\r\n0\r\n\r\n"
    )
    assert (await served.raw(chunked))[0] == 413
    # Just too long to be read: of one that is longer, the answer may be lost in a reset.
    head = f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\nX: "
    assert (await served.raw(head.encode().ljust(16_385, b"y")))[0] == 400
    assert (await served.request("GET", "/session"))[0] == 401


async def test_files_are_compressed_once_and_not_sent_again(site: Any, tmp_path: Path) -> None:
    """Nor anything else: the meanings of the counters come from the code."""
    (tmp_path / "index.html").write_text("<p>" * 500)
    served = await site(endpoint=free_endpoint(), folder=tmp_path)
    status, headers, body = await served.request("GET", "/")
    assert status == 200
    assert headers["content-type"].startswith("text/html")
    status, small, packed = await served.request("GET", "/", Accept_Encoding="gzip, br")
    assert small["content-encoding"] == "gzip"
    assert len(packed) < len(body)
    status, _, nothing = await served.request("GET", "/", If_None_Match=headers["etag"])
    assert (status, nothing) == (304, b"")


async def test_the_meaning_of_every_counter_is_served(site: Any) -> None:
    served = await site(endpoint=free_endpoint())
    status, _, body = await served.request("GET", "/counters")
    groups = json.loads(body)
    assert status == 200
    assert set(groups) == {"board", "link", "command", "sources", "bus"}
    assert groups["link"]["readings"]["kind"] == "counter"
    assert all(each["meaning"] for group in groups.values() for each in group.values())


async def test_no_token_and_no_cookie_is_logged(
    site: Any, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    caplog.set_level(logging.DEBUG)
    served = await site(endpoint=free_endpoint(), phones=True)
    token = served.link()
    _, headers, _ = await served.request("POST", "/session", login(token))
    cookie = headers["set-cookie"].split("; ")[0]
    # A person who puts it into the wrong place.
    await served.request("GET", f"/?token={token}")
    await served.request("GET", f"/{token}", Cookie=f"a={token}")
    await served.raw(f"{token}\r\n\r\n".encode())
    await served.request("POST", "/session", login(token))
    page = await served.open(additional_headers={"Cookie": cookie})
    await page.socket.send(token)
    await page.close_code()
    await served.sessions.end(served.sessions.all[0])
    await served.request("GET", "/session", Cookie=cookie)
    written = caplog.text + "".join(capfd.readouterr())
    server_lines = [
        f"{record.name} {record.getMessage()}"
        for record in caplog.records
        # The client in this process is the test's own.
        if not record.name.startswith("websockets.client")
    ]
    assert written
    secret = cookie.partition(".")[2]
    assert len(secret) == 22
    assert not [line for line in server_lines if token in line or secret in line]


async def test_a_slow_body_is_given_up(site: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("yahboomd.web.session_routes.BODY_S", 0.05)
    served = await site(endpoint=free_endpoint(), phones=True)
    head = (
        f"POST /session HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\nOrigin: {served.origin}\r\n"
        "Content-Length: 100\r\nConnection: close\r\n\r\n{"
    )
    assert (await served.raw(head.encode()))[0] == 413
    await eventually(lambda: not served.server.server_state.tasks)
    assert asyncio.get_running_loop().is_running()
