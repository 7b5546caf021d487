"""Downloads are for people with a session, of recordings alone, and end where they are not read."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import BinaryIO

import pytest
from web_site import TOKENS, Site
from zenoh_fixtures import free_endpoint

from yahboomd.web import page_downloads, web_server

Start = Callable[..., Awaitable[Site]]

pytestmark = pytest.mark.realtime

LARGE = 20_000_000


@pytest.fixture
def file(tmp_path: Path) -> Path:
    folder = tmp_path / "recordings" / "run-001"
    folder.mkdir(parents=True)
    (tmp_path / "secret").write_text("secret")
    path = folder / "native_0.mcap"
    path.write_bytes(bytes(range(256)) * (LARGE // 256))
    return path


@pytest.mark.parametrize(
    "path",
    [
        "/recordings/../secret",
        "/recordings/%2e%2e/secret",
        "/recordings/..%2f..%2fsecret/native_0.mcap",
        "/recordings/run-001/..%2f..%2fsecret",
        "/recordings/run-001/%2e%2e/%2e%2e/secret",
        "/recordings//etc/passwd",
        "/recordings/%2fetc/passwd",
        "/recordings/run-001/native_0.mcap%00",
        "/recordings/run-001/",
        "/recordings/run-001/native_9.mcap",
    ],
)
async def test_no_path_leads_to_another_file(site: Start, file: Path, path: str) -> None:
    served = await site(endpoint=free_endpoint())
    status, _, body = await served.request("GET", path)
    assert (status, b"secret" in body, b"root:" in body) == (404, False, False)


async def test_a_large_file_arrives_whole_and_only_with_a_session(site: Start, file: Path) -> None:
    served = await site(endpoint=free_endpoint(), tokens=TOKENS)
    path = "/recordings/run-001/native_0.mcap"
    assert (await served.request("GET", path))[0] == 401
    status, headers, body = await served.request("GET", path, **served.cookie("viewer"))
    assert (status, headers["x-content-type-options"]) == (200, "nosniff")
    assert body == file.read_bytes()


async def test_a_file_that_grows_is_sent_as_far_as_it_was(site: Start, file: Path) -> None:
    served = await site(endpoint=free_endpoint())
    before = file.read_bytes()
    reader, writer = await asyncio.open_connection("127.0.0.1", served.port)
    writer.write(
        b"GET /recordings/run-001/native_0.mcap HTTP/1.1\r\n"
        + f"Host: 127.0.0.1:{served.port}\r\nConnection: close\r\n\r\n".encode()
    )
    head = await reader.readuntil(b"\r\n\r\n")
    assert f"content-length: {len(before)}".encode() in head.lower()
    with file.open("ab") as stream:
        stream.write(b"more")
    assert await reader.read(-1) == before
    writer.close()


async def test_downloads_that_are_not_read_are_cut_off_and_no_more_than_some_run_at_once(
    site: Start, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A busy machine opens the last one before the first is cut off.
    monkeypatch.setattr(page_downloads, "STALLED_S", 2.0)
    served = await site(endpoint=free_endpoint())
    request = (
        b"GET /recordings/run-001/native_0.mcap HTTP/1.1\r\n"
        + f"Host: 127.0.0.1:{served.port}\r\n\r\n".encode()
    )
    opened = []
    for _ in range(page_downloads.AT_ONCE):
        reader, writer = await asyncio.open_connection("127.0.0.1", served.port, limit=1000)
        writer.write(request)
        assert b" 200 " in await reader.readline()
        opened.append((reader, writer))
    status, _, _ = await served.request("GET", "/recordings/run-001/native_0.mcap")
    assert status == 503

    async def served_again() -> bool:
        status, _, body = await served.request("GET", "/recordings/run-001/native_0.mcap")
        return status == 200 and len(body) == file.stat().st_size

    async with asyncio.timeout(20):
        while not await served_again():
            await asyncio.sleep(0.1)
    for _, writer in opened:
        writer.close()


async def test_downloads_that_are_asked_for_at_once_are_no_more_either(
    site: Start, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = page_downloads._opened

    def opened_late(path: Path) -> tuple[BinaryIO, int]:
        time.sleep(0.3)
        return opened(path)

    monkeypatch.setattr(page_downloads, "_opened", opened_late)
    served = await site(endpoint=free_endpoint())
    path = "/recordings/run-001/native_0.mcap"
    more = page_downloads.AT_ONCE + 2
    async with asyncio.timeout(60):
        answers = await asyncio.gather(*[served.request("GET", path) for _ in range(more)])
    statuses = sorted(status for status, _, _ in answers)
    assert statuses == [200] * page_downloads.AT_ONCE + [503] * 2


async def test_viewers_leave_downloads_to_drivers_and_to_each_other(
    site: Start, file: Path
) -> None:
    served = await site(endpoint=free_endpoint(), tokens=TOKENS)
    path = "/recordings/run-001/native_0.mcap"

    async def begin(role: str, source: str) -> tuple[bytes, asyncio.StreamWriter]:
        reader, writer = await asyncio.open_connection(
            "127.0.0.1", served.port, limit=1000, local_addr=(source, 0)
        )
        (cookie,) = served.cookie(role).values()
        head = f"Host: 127.0.0.1:{served.port}\r\nCookie: {cookie}\r\n\r\n"
        writer.write(f"GET {path} HTTP/1.1\r\n{head}".encode())
        return (await reader.readline()).split()[1], writer

    askers = [("viewer", f"127.0.0.{at}") for at in (1, 1, 1, 2, 2, 3)]
    begun = [await begin(*asker) for asker in [*askers, ("driver", "127.0.0.1")]]
    assert [status for status, _ in begun] == [
        *(b"200", b"200", b"503"),
        *(b"200", b"200"),
        *(b"503", b"200"),
    ]
    for _, writer in begun:
        writer.transport.abort()


async def test_a_download_may_take_longer_than_a_request_has_to_begin(
    site: Start, file: Path
) -> None:
    served = await site(endpoint=free_endpoint())
    # The requests beside it have the usual time: a busy machine may need it.
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(web_server, "WAIT_S", 1.0)
        reader, writer = await asyncio.open_connection("127.0.0.1", served.port, limit=1000)
        writer.write(
            b"GET /recordings/run-001/native_0.mcap HTTP/1.1\r\n"
            + f"Host: 127.0.0.1:{served.port}\r\nConnection: close\r\n\r\n".encode()
        )
        await reader.readuntil(b"\r\n\r\n")
    for _ in range(15):
        await asyncio.sleep(0.1)
        assert (await served.request("GET", "/session"))[0] == 200
    assert len(await reader.read(-1)) == file.stat().st_size
    writer.close()
