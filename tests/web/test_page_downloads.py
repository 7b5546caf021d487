"""Downloads are for people with a session, of recordings alone, and end if they are not read."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import BinaryIO

import pytest
from web_site import Site
from zenoh_fixtures import PATIENCE_S, eventually, free_endpoint

from yahboomd.web import page_downloads
from yahboomd.web.web_server import CountedConnection

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


async def test_no_path_leads_to_another_file(site: Start, file: Path) -> None:
    served = await site(endpoint=free_endpoint())
    for path in (
        *("../secret", "%2e%2e/secret", "..%2f..%2fsecret/native_0.mcap"),
        *("run-001/..%2f..%2fsecret", "run-001/%2e%2e/%2e%2e/secret", "/etc/passwd"),
        *("%2fetc/passwd", "run-001/native_0.mcap%00", "run-001/", "run-001/native_9.mcap"),
    ):
        status, _, body = await served.request("GET", f"/recordings/{path}")
        assert (status, b"secret" in body, b"root:" in body) == (404, False, False), path


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


async def unread(served: Site) -> list[asyncio.StreamWriter]:
    """As many downloads as there may be at once, which are not read."""
    request = (
        b"GET /recordings/run-001/native_0.mcap HTTP/1.1\r\n"
        + f"Host: 127.0.0.1:{served.port}\r\n\r\n".encode()
    )
    opened = []
    for _ in range(page_downloads.AT_ONCE):
        reader, writer = await asyncio.open_connection("127.0.0.1", served.port, limit=1000)
        writer.write(request)
        assert b" 200 " in await reader.readline()
        opened.append(writer)
    return opened


async def test_no_more_than_some_downloads_run_at_once(
    site: Start, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened, go = page_downloads._opened, threading.Event()

    def opened_late(path: Path) -> tuple[BinaryIO, int]:
        go.wait(PATIENCE_S)
        return opened(path)

    monkeypatch.setattr(page_downloads, "_opened", opened_late)
    more = page_downloads.AT_ONCE + 2
    # A thread for each that waits.
    asyncio.get_running_loop().set_default_executor(ThreadPoolExecutor(2 * more))
    served = await site(endpoint=free_endpoint())
    path = "/recordings/run-001/native_0.mcap"
    asking = [asyncio.create_task(served.request("GET", path)) for _ in range(more)]
    try:
        await eventually(lambda: sum(each.done() for each in asking) == 2)
    finally:
        go.set()
    statuses = sorted([status for status, _, _ in await asyncio.gather(*asking)])
    assert statuses == [200] * page_downloads.AT_ONCE + [503] * 2


async def test_downloads_that_are_not_read_are_cut_off(
    site: Start, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page_downloads, "STALLED_S", 0.5)
    served = await site(endpoint=free_endpoint())
    opened = await unread(served)

    async def served_again() -> bool:
        status, _, body = await served.request("GET", "/recordings/run-001/native_0.mcap")
        return status == 200 and len(body) == file.stat().st_size

    async with asyncio.timeout(PATIENCE_S):
        while not await served_again():
            await asyncio.sleep(0.1)
    for writer in opened:
        writer.close()


async def test_viewers_leave_downloads_to_drivers_and_to_each_other(
    site: Start, file: Path
) -> None:
    served = await site(endpoint=free_endpoint(), phones=True)
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
    reader, writer = await asyncio.open_connection("127.0.0.1", served.port, limit=1000)
    writer.write(
        b"GET /recordings/run-001/native_0.mcap HTTP/1.1\r\n"
        + f"Host: 127.0.0.1:{served.port}\r\nConnection: close\r\n\r\n".encode()
    )
    await reader.readuntil(b"\r\n\r\n")
    loop = asyncio.get_running_loop()
    (connection,) = [each for each in CountedConnection.waiting if each.loop is loop]
    # As its timer does, once the time to begin is over.
    connection._overdue()
    assert len(await reader.read(-1)) == file.stat().st_size
    writer.close()
