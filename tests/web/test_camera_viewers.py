"""Pages that look: with a session, the newest picture alone, and one connection for all."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from typing import Any, Self, cast

import pytest
from camera_upstream import CameraInMemory, CameraOnSocket, jpeg, part
from starlette.websockets import WebSocketDisconnect
from web_site import Site
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import InvalidStatus
from zenoh_fixtures import PATIENCE_S, eventually, free_endpoint

from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time
from yahboomd.web.camera import (
    ANSWER_S,
    COUNTS,
    COUNTS_S,
    FULL,
    HEAD,
    IDLE_S,
    MAX_LOOKING,
    MAX_LOOKING_VIEWERS,
    POLICY,
    CameraFeed,
    CameraViewers,
)
from yahboomd.web.session_files import Role

Start = Callable[..., Awaitable[Site]]


class Looker:
    """A page that looks, in memory."""

    def __init__(self) -> None:
        self.role: Role | None = "viewer"
        self.sent: list[Any] = []
        self.closed: int | None = None
        self.is_served = False
        self._asked: asyncio.Queue[str | None] = asyncio.Queue()

    def ask(self, question: str = "") -> None:
        """Ask for the next picture, or something else."""
        self._asked.put_nowait(question)

    def leave(self) -> None:
        """Close the page."""
        self._asked.put_nowait(None)

    async def receive_text(self) -> str:
        """As the server's WebSocket does."""
        self.is_served = True
        text = await self._asked.get()
        if text is None:
            raise WebSocketDisconnect(1001)
        return text

    async def send_text(self, text: str) -> None:
        """As the server's WebSocket does."""
        self.sent.append(json.loads(text))

    async def send_bytes(self, data: bytes) -> None:
        """As the server's WebSocket does."""
        self.sent.append((*HEAD.unpack(data[: HEAD.size]), data[HEAD.size :].removesuffix(b"\r\n")))

    async def close(self, code: int = 1000, _reason: str = "") -> None:
        """As the server's WebSocket does."""
        self.closed = code

    def attend(self, viewers: CameraViewers) -> asyncio.Task[None]:
        """Have it served."""
        return asyncio.create_task(viewers.attend(cast("Any", self), lambda: self.role))


class Stage:
    """A camera and its viewers, in memory."""

    def __init__(self) -> None:
        self.camera = CameraInMemory()
        self.clock = LoopClock()
        self.feed = CameraFeed("http://camera/", self.clock, self.camera.connect)
        self.viewers = CameraViewers(self.feed, self.clock)

        self.attending: list[asyncio.Task[None]] = []

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_why: object) -> None:
        for each in self.attending:
            each.cancel()
        await asyncio.gather(*self.attending, return_exceptions=True)

    async def page(self, role: Role = "viewer") -> Looker:
        """One page, and the camera's connection is open."""
        looker = Looker()
        looker.role = role
        self.attending.append(looker.attend(self.viewers))
        await eventually(lambda: looker.closed or (looker.is_served and self.camera.open_lines))
        return looker

    def send(self, number: int) -> None:
        """A picture from the camera."""
        self.camera.lines[-1].send(part(jpeg(number)))


@on_virtual_time
async def test_a_page_gets_the_newest_picture_and_a_slow_one_skips() -> None:
    async with Stage() as stage:
        slow, quick = await stage.page(), await stage.page()
        for number in range(10):
            quick.ask()
            stage.send(number)
            await eventually(lambda number=number: len(quick.sent) == number + 1)
        slow.ask()
        await eventually(lambda: slow.sent)
        slow.ask()
        await asyncio.sleep(0.5 * ANSWER_S)
        assert [sent[2] for sent in quick.sent] == [jpeg(number) for number in range(10)]
        # One answer to one question: nothing is queued for it, and no picture is sent twice.
        assert [sent[2] for sent in slow.sent] == [jpeg(9)]


@on_virtual_time
async def test_each_picture_has_its_age_here_and_how_long_the_page_waited() -> None:
    async with Stage() as stage:
        page = await stage.page()
        stage.send(1)
        await asyncio.sleep(0.8)
        page.ask()
        await eventually(lambda: page.sent)
        age_ms, waited_ms, _ = page.sent[0]
        assert 790 <= age_ms <= 830
        assert waited_ms < 5
        page.ask()
        await asyncio.sleep(0.6)
        stage.send(2)
        await eventually(lambda: len(page.sent) == 2)
        age_ms, waited_ms, _ = page.sent[1]
        assert age_ms < 30
        assert 580 <= waited_ms <= 620


@on_virtual_time
async def test_without_a_new_picture_a_page_learns_every_second_why() -> None:
    async with Stage() as stage:
        page = await stage.page()
        page.ask()
        await asyncio.sleep(1.5 * ANSWER_S)
        assert [sent["problem"] for sent in page.sent] == [""]
        page.ask()
        stage.camera.lines[0].close()
        await eventually(lambda: len(page.sent) == 2)
        assert "closed the connection" in page.sent[1]["problem"]
        assert page.sent[1]["counts"]["closed"] == 1


@on_virtual_time
async def test_the_counts_are_answered_at_once_and_cost_no_picture() -> None:
    async with Stage() as stage:
        page = await stage.page()
        stage.send(1)
        stage.send(1)
        await eventually(lambda: stage.feed.counts["repeated"])
        page.ask(COUNTS)
        page.ask()
        await eventually(lambda: len(page.sent) == 2)
        assert page.sent[0]["counts"] == {
            "connected": 1, "pictures": 1, "repeated": 1, "unusable": 0
        }  # fmt: skip
        assert page.sent[1][2] == jpeg(1)


@on_virtual_time
async def test_a_page_that_asks_for_counts_without_end_delays_no_commands() -> None:
    async with Stage() as stage:
        page = await stage.page()
        for _ in range(1000):
            page.ask(COUNTS)
        await asyncio.sleep(20.5 * COUNTS_S)
        assert len(page.sent) <= 22


@on_virtual_time
async def test_a_page_whose_session_ends_gets_no_further_picture() -> None:
    async with Stage() as stage:
        page = await stage.page()
        page.ask()
        stage.send(1)
        await eventually(lambda: page.sent)
        page.role = None
        page.ask()
        stage.send(2)
        await eventually(lambda: page.closed == POLICY)
        assert len(page.sent) == 1
        await eventually(lambda: not stage.camera.open_lines)


@on_virtual_time
async def test_a_page_that_asks_for_nothing_does_not_keep_the_camera_open() -> None:
    async with Stage() as stage:
        page = await stage.page()
        await asyncio.sleep(0.9 * IDLE_S)
        assert stage.camera.open_lines == 1
        await asyncio.sleep(0.2 * IDLE_S)
        assert page.closed == 1000
        assert stage.camera.open_lines == 0


@on_virtual_time
async def test_many_viewers_leave_room_for_drivers_and_more_are_told() -> None:
    async with Stage() as stage:
        lookers = [await stage.page("viewer") for _ in range(MAX_LOOKING_VIEWERS + 1)]
        assert [page.closed for page in lookers] == [None] * MAX_LOOKING_VIEWERS + [FULL]
        drivers = [await stage.page("driver") for _ in range(MAX_LOOKING - MAX_LOOKING_VIEWERS + 1)]
        assert [page.closed for page in drivers[-2:]] == [None, FULL]
        lookers[0].leave()
        await asyncio.sleep(0.1)
        assert (await stage.page("driver")).closed is None


class Look:
    """A page's WebSocket to the camera: ``async with Look(site, role) as look``."""

    def __init__(self, served: Site, role: str = "", **options: Any) -> None:
        self._options = {
            "origin": served.origin,
            "additional_headers": served.cookie(role) if role else {},
            "open_timeout": PATIENCE_S,
            **options,
        }
        self._address = served.origin.replace("http", "ws", 1) + "/camera"

    async def __aenter__(self) -> Self:
        self.socket: ClientConnection = await connect(self._address, **self._options)
        return self

    async def __aexit__(self, *_why: object) -> None:
        await self.socket.close()

    async def picture(self) -> bytes:
        """The next picture."""
        while True:
            await self.socket.send("")
            if isinstance(answer := await self.socket.recv(), bytes):
                return answer[HEAD.size :].removesuffix(b"\r\n")


@pytest.mark.realtime
async def test_a_viewer_may_look_and_without_a_session_nobody_does(site: Start) -> None:
    async with CameraOnSocket() as camera:
        served = await site(endpoint=free_endpoint(), phones=True, camera=camera.address)
        for options in ({}, {"additional_headers": {"Cookie": f"yahboomd-{served.port}=x"}}):
            with pytest.raises(InvalidStatus, match="401"):
                await Look(served, **options).__aenter__()
        with pytest.raises(InvalidStatus, match="403"):
            await Look(served, "driver", origin="http://evil.example").__aenter__()
        assert camera.asked == []
        async with Look(served, "viewer") as look:
            await eventually(lambda: camera.writers)
            camera.send(jpeg(1))
            assert await look.picture() == jpeg(1)
        assert camera.asked[0].startswith(b"GET /?action=stream HTTP/1.1\r\n")
        # Nothing of the page's request goes to the camera.
        assert b"ookie" not in camera.asked[0]
        await eventually(lambda: not camera.writers)


@pytest.mark.realtime
async def test_a_page_that_reads_no_picture_delays_neither_others_nor_the_estop(
    fake_daemon: Any, site: Start
) -> None:
    large = jpeg(bytes(900_000))
    async with CameraOnSocket() as camera:
        served = await site(await fake_daemon(), phones=True, camera=camera.address)
        stuck = await Look(served, "viewer", max_queue=1).__aenter__()
        stuck.socket.transport.pause_reading()
        await eventually(lambda: camera.writers)
        for _ in range(40):
            await stuck.socket.send("")
        async with Look(served, "driver", max_size=None) as look:
            for number in range(5):
                camera.send(jpeg(large + bytes([number])))
                assert len(await look.picture()) > 900_000
            status, _, body = await served.request("POST", "/estop", **served.cookie("viewer"))
            assert (status, json.loads(body)["engaged"]) == (200, True)
        stuck.socket.transport.abort()


@pytest.mark.realtime
@pytest.mark.parametrize(("sent", "code"), [("x" * 5000, 1009), (b"x", POLICY)])
async def test_a_page_that_sends_much_or_no_text_is_closed_with_a_code(
    site: Start, sent: str | bytes, code: int
) -> None:
    async with CameraOnSocket() as camera:
        served = await site(endpoint=free_endpoint(), camera=camera.address)
        look = await Look(served).__aenter__()
        await look.socket.send(sent)
        await eventually(lambda: look.socket.close_code == code)


@pytest.mark.realtime
async def test_a_robot_without_a_camera_has_no_such_address_and_its_page_knows(
    site: Start,
) -> None:
    served = await site(endpoint=free_endpoint())
    assert (await (await served.page()).one("hello"))["camera"] is False
    with pytest.raises(InvalidStatus):
        await Look(served).__aenter__()
    async with CameraOnSocket() as camera:
        served = await site(endpoint=free_endpoint(), camera=camera.address)
        assert (await (await served.page()).one("hello"))["camera"] is True
        # Nobody looks: its page alone opens nothing.
        assert camera.asked == []
