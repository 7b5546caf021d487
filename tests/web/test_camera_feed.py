"""One connection to a camera that may send anything: counted, in words, and asked again."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest
from camera_upstream import BOUNDARY, OK, CameraInMemory, jpeg, part
from zenoh_fixtures import eventually

from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time
from yahboomd.web.camera import (
    AT_ONCE,
    HEAD_S,
    LONGEST_PAUSE_S,
    MOST_PICTURES,
    MOST_PIECES,
    PAUSE_S,
    PICTURE_S,
    CameraFeed,
)
from yahboomd.web.mjpeg_parts import MAX_PICTURE_BYTES

ADDRESS = "http://camera:81/stream?size=9"


def feed_of(camera: CameraInMemory) -> CameraFeed:
    return CameraFeed(ADDRESS, LoopClock(), camera.connect)


@asynccontextmanager
async def looked_at(camera: CameraInMemory) -> AsyncIterator[CameraFeed]:
    feed = feed_of(camera)
    with feed.looked_at():
        await eventually(lambda: camera.made_s)
        yield feed


@on_virtual_time
async def test_it_is_open_only_while_somebody_looks_and_once_for_all() -> None:
    camera = CameraInMemory()
    feed = feed_of(camera)
    await asyncio.sleep(60.0)
    assert camera.lines == []
    with feed.looked_at():
        with feed.looked_at(), feed.looked_at():
            await eventually(lambda: camera.lines)
        camera.lines[0].send(part(jpeg(1)))
        assert await feed.news(0, "", 1.0)
        assert camera.open_lines == 1
    await eventually(lambda: not camera.open_lines)
    assert feed.newest is None
    with feed.looked_at():
        await eventually(lambda: camera.open_lines == 1)
    assert len(camera.lines) == 2


@on_virtual_time
async def test_it_asks_for_the_path_and_the_query_and_sends_no_more() -> None:
    camera = CameraInMemory()
    async with looked_at(camera):
        assert camera.lines[0].asked.split(b"\r\n") == [
            b"GET /stream?size=9 HTTP/1.1",
            b"Host: camera:81",
            b"Accept: multipart/x-mixed-replace",
            b"",
            b"",
        ]


@on_virtual_time
async def test_only_the_newest_picture_is_kept_and_its_age_counts_from_its_arrival() -> None:
    camera = CameraInMemory()
    async with looked_at(camera) as feed:
        for number in range(5):
            camera.lines[0].send(part(jpeg(number)))
        picture = await feed.news(0, "", 1.0)
        assert picture is not None
        assert picture.jpeg.removesuffix(b"\r\n") == jpeg(4)
        await asyncio.sleep(0.7)
        assert feed.age_ns(picture) == pytest.approx(700_000_000, abs=20_000_000)
        assert await feed.news(picture.number, "", 0.5) is None


@on_virtual_time
async def test_the_time_of_a_suspend_makes_a_picture_older() -> None:
    camera, clock = CameraInMemory(), LoopClock()
    feed = CameraFeed(ADDRESS, clock, camera.connect)
    with feed.looked_at():
        await eventually(lambda: camera.lines)
        camera.lines[0].send(part(jpeg(1)))
        picture = await feed.news(0, "", 1.0)
        assert picture is not None
        clock.slept_ns += 3_600_000_000_000
        assert feed.age_ns(picture) >= 3_600_000_000_000


@on_virtual_time
async def test_a_picture_that_is_repeated_is_not_new_and_the_page_learns_why() -> None:
    camera = CameraInMemory()
    async with looked_at(camera) as feed:
        for _ in range(30):
            camera.lines[0].send(part(jpeg(1)))
            await asyncio.sleep(0.1)
        assert (feed.counts["pictures"], feed.counts["repeated"]) == (1, 29)
        assert feed.newest is not None
        assert feed.age_ns(feed.newest) > 2_900_000_000
        assert "repeats one picture" in feed.problem
        # Also over a new connection.
        camera.lines[0].close()
        await eventually(lambda: len(camera.lines) == 2)
        camera.lines[1].send(part(jpeg(1)))
        await eventually(lambda: feed.counts["repeated"] == 30)
        camera.lines[1].send(part(jpeg(2)))
        await eventually(lambda: feed.counts["pictures"] == 2)
        assert feed.problem == ""


def head(status: str = "200 OK", kind: str = "multipart/x-mixed-replace; boundary=frame") -> bytes:
    return f"HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nLocation: http://x/\r\n\r\n".encode()


def chunked(content: bytes) -> bytes:
    """A part of it, each byte of its picture in a chunk of its own."""
    begin = f"--{BOUNDARY}\r\n\r\n".encode()
    first = f"{len(begin):x}\r\n".encode() + begin + b"\r\n"
    return first + b"".join(b"1\r\n%c\r\n" % each for each in content)


CHUNKS = head().replace(b"\r\n\r\n", b"\r\nTransfer-Encoding: chunked\r\n\r\n")

HOSTILE = [
    pytest.param(
        CHUNKS + chunked(b"x" * 2 * MOST_PIECES), "flood", "make them larger", id="chunks"
    ),
    pytest.param(head("302 Found"), "redirect", "is not followed", id="redirect"),
    pytest.param(head("401 Unauthorized"), "refused", "wants a password", id="password"),
    pytest.param(head("404 Not Found"), "refused", "status 404", id="not-found"),
    pytest.param(head(kind="text/html"), "wrong_type", "sends text/html, not MJPEG", id="type"),
    pytest.param(head(kind="image/jpeg"), "wrong_type", "sends image/jpeg", id="one-picture"),
    pytest.param(head(kind="\x01<b>"), "wrong_type", "sends without a type", id="odd-type"),
    pytest.param(
        head(kind="multipart/x-mixed-replace"), "no_boundary", "no boundary", id="unnamed"
    ),
    pytest.param(head() + b"x" * 9000, "no_boundary", "without the boundary", id="no-boundary"),
    pytest.param(OK + b"X: " + b"x" * 9000, "endless_header", "does not end", id="header-of-part"),
    pytest.param(b"HTTP/1.1 200 OK\r\nX: " + b"x" * 40000, "not_http", "no proper", id="header"),
    pytest.param(b"SSH-2.0-OpenSSH_9.2\r\n\r\n", "not_http", "no proper answer", id="not-http"),
    pytest.param(
        OK + b"\r\n" + b"x" * (2 * MAX_PICTURE_BYTES), "large", "make them smaller", id="endless"
    ),
    pytest.param(
        OK + b"Content-Length: 99999999\r\n\r\n", "large", "more than 1024 kB", id="announced"
    ),
    pytest.param(OK + part(jpeg(1)) * (MOST_PICTURES + 1), "flood", "lower its rate", id="flood"),
    pytest.param(OK + part(b"") * (MOST_PICTURES + 1), "flood", "lower its rate", id="no-jpegs"),
]


@pytest.mark.parametrize(("sent", "cause", "words"), HOSTILE)
@on_virtual_time
async def test_a_hostile_camera_is_cut_off_counted_and_asked_again(
    sent: bytes, cause: str, words: str
) -> None:
    camera = CameraInMemory(greeting=sent)
    async with looked_at(camera) as feed:
        await eventually(lambda: feed.problem)
        assert words in feed.problem
        assert feed.problem.startswith("The camera at camera:81 ")
        assert feed.counts[cause] == 1
        assert camera.open_lines == 0
        camera.greeting = OK
        await eventually(lambda: camera.open_lines)
        camera.lines[-1].send(part(jpeg(7)))
        await eventually(lambda: feed.problem == "")
        assert feed.newest is not None


@on_virtual_time
async def test_between_small_chunks_the_pages_have_their_turn() -> None:
    """Else they would get no beats, and the robot could not be driven."""
    camera = CameraInMemory(greeting=CHUNKS)
    async with looked_at(camera) as feed:
        await eventually(lambda: camera.lines)
        turns = 0
        camera.lines[0].send(chunked(jpeg(b"x" * 2000) + f"--{BOUNDARY}\r\n".encode()))
        while feed.newest is None:
            await asyncio.sleep(0)
            turns += 1
        assert turns >= 2000 // AT_ONCE
        assert feed.problem == ""


@on_virtual_time
async def test_the_pauses_grow_to_8_s_and_begin_anew_after_a_picture() -> None:
    camera = CameraInMemory()
    camera.is_there = False
    async with looked_at(camera) as feed:
        await asyncio.sleep(60.0)
        assert "does not answer: Connection refused" in feed.problem
        pauses = [b - a for a, b in zip(camera.made_s, camera.made_s[1:], strict=False)]
        assert pauses[:4] == pytest.approx([2.0, 4.0, 8.0, LONGEST_PAUSE_S], abs=0.01)
        assert max(pauses) < LONGEST_PAUSE_S + 0.01
        assert feed.counts["no_answer"] == len(camera.made_s)
        camera.is_there = True
        await eventually(lambda: camera.lines)
        camera.lines[0].send(part(jpeg(1)))
        await eventually(lambda: feed.newest)
        camera.lines[0].close()
        await eventually(lambda: len(camera.lines) == 2)
        assert camera.made_s[-1] - camera.made_s[-2] < PAUSE_S + 0.1
        assert feed.counts["closed"] == 1


@on_virtual_time
async def test_pages_that_come_and_go_do_not_hurry_a_camera_that_fails() -> None:
    camera = CameraInMemory()
    camera.is_there = False
    feed = feed_of(camera)
    for _ in range(100):
        with feed.looked_at():
            await asyncio.sleep(0.05)
    # 5 s later.
    assert 2 <= len(camera.made_s) <= 4


@on_virtual_time
async def test_a_slow_drip_is_cut_off() -> None:
    camera = CameraInMemory(greeting=b"")
    async with looked_at(camera) as feed:
        began_s = camera.made_s[0]

        async def drip(data: bytes) -> float:
            loop = asyncio.get_running_loop()
            line = camera.lines[-1]
            for at in range(len(data)):
                if not line.is_open:
                    break
                line.send(data[at : at + 1])
                await asyncio.sleep(0.2)
            return loop.time()

        assert await drip(b"HTTP/1.0 200 OK\r\nX: " + b"x" * 1000) - began_s < HEAD_S + 0.3
        assert feed.counts["slow"] == 1
        camera.greeting = OK
        await eventually(lambda: len(camera.lines) == 2)
        began_s = camera.made_s[-1]
        assert await drip(part(jpeg(b"x" * 1000))) - began_s < PICTURE_S + 0.3
        assert feed.counts["slow"] == 2
        assert "no whole picture in time" in feed.problem


@on_virtual_time
async def test_a_camera_that_sends_a_picture_now_and_then_stays_connected() -> None:
    camera = CameraInMemory()
    async with looked_at(camera) as feed:
        for number in range(6):
            camera.lines[0].send(part(jpeg(number)))
            await asyncio.sleep(0.8 * PICTURE_S)
        assert (len(camera.lines), feed.counts["pictures"]) == (1, 6)


@on_virtual_time
async def test_a_stream_in_chunks_is_understood() -> None:
    """As an ESP32-CAM and go2rtc send it."""
    camera = CameraInMemory(
        f"HTTP/1.1 200 OK\r\nContent-Type: multipart/x-mixed-replace;boundary={BOUNDARY}\r\n"
        "Transfer-Encoding: chunked\r\n\r\n".encode()
    )
    async with looked_at(camera) as feed:
        for piece in (f"\r\n--{BOUNDARY}\r\n".encode(), part(jpeg(3))):
            camera.lines[0].send(b"%x\r\n%b\r\n" % (len(piece), piece))
        picture = await feed.news(0, "", 1.0)
        assert picture is not None
        camera.lines[0].close()
        await eventually(lambda: feed.counts["closed"] == 1)


@on_virtual_time
async def test_a_camera_without_a_path_is_asked_for_its_root() -> None:
    camera = CameraInMemory()
    feed = CameraFeed("http://[fd00::1]", LoopClock(), camera.connect)
    with feed.looked_at():
        await eventually(lambda: camera.lines)
        assert camera.lines[0].asked.startswith(b"GET / HTTP/1.1\r\nHost: [fd00::1]\r\n")
