"""The page's server as a process, a real daemon, a simulated board: whatever loses the thumb stops
the wheels, and nothing that was queued meanwhile moves them.
"""

from __future__ import annotations

import asyncio
import re
import signal
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import suppress
from typing import Any

import pytest
from real_robot import Process, RealRobot
from stalled_relay import StalledRelay
from web_site import Page
from websockets.asyncio.client import connect
from zenoh_fixtures import PATIENCE_S, eventually

from yahboomd.core.standstill import STANDING_M_S

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("page")]


class Served:
    """A robot with its page."""

    def __init__(self, robot: RealRobot, web: Process) -> None:
        self.robot = robot
        self.web = web
        found = re.search(r"http://127\.0\.0\.1:(\d+)/", web.output)
        assert found is not None, web.output
        self.port = int(found[1])
        self.pages: list[Page] = []

    async def driver(self, port: int = 0) -> Page:
        """A page with control, perhaps over a relay."""
        page = Page(
            await connect(
                f"ws://127.0.0.1:{port or self.port}/ws",
                origin=f"http://127.0.0.1:{port or self.port}",
                compression=None,
                open_timeout=PATIENCE_S,
            )
        )
        self.pages.append(page)
        await page.one("daemon", alive=True)
        await page.one("status")
        await page.send(type="control", want=True)
        await page.one("control", mine=True)
        return page

    async def driving(self, port: int = 0) -> Page:
        """A page that drives the robot."""
        page = await self.driver(port)
        await page.press(self.moves, vx=0.3)
        return page

    @property
    def speed_m_s(self) -> float:
        return max(map(abs, self.robot.truth()[-1].speed_m_s))

    def moves(self) -> bool:
        return self.speed_m_s > 0.2

    def stands(self) -> bool:
        return self.robot.stands()

    async def stays(self, page: Page, beats: int = 20) -> None:
        """Assert that the wheels stand from now on, for this number of a page's beats."""
        begun, last = len(self.robot.truth()), page.beat + beats
        await eventually(lambda: page.beat > last)
        since = self.robot.truth()[begun:]
        assert since
        assert max(max(map(abs, each.speed_m_s)) for each in since) < STANDING_M_S


@pytest.fixture(scope="module")
def one_robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RealRobot]:
    made = RealRobot(tmp_path_factory.mktemp("robot"))
    made.daemon.says("Connected to")
    yield made
    made.close()


@pytest.fixture
async def served(one_robot: RealRobot) -> AsyncIterator[Callable[..., Awaitable[Served]]]:
    running: list[Served] = []

    async def start(*arguments: str) -> Served:
        words = ("web", "--listen", "127.0.0.1:0", "--connect", one_robot.endpoint, *arguments)
        web = Process(*words)
        await eventually(lambda: "The page is at" in web.output)
        running.append(Served(one_robot, web))
        await eventually(running[-1].stands)
        return running[-1]

    yield start
    for each in running:
        for page in each.pages:
            await page.close()
        each.web.process.send_signal(signal.SIGCONT)
        await asyncio.to_thread(each.web.end)
        # pytest shows it if the test failed.
        print(each.web.output)
        assert "Traceback" not in each.web.output


async def test_a_page_that_is_closed_or_falls_silent_in_motion_leaves_standing_wheels(
    served: Any,
) -> None:
    """A closed tab, a lost network, a laptop that sleeps; a server that ends."""
    site = await served()
    closed = await site.driving()
    closed.socket.transport.abort()
    await eventually(site.stands)
    silent = await site.driving()
    await eventually(site.stands)
    assert (await silent.one("refused", why="lapse"))["text"]
    await site.stays(silent)
    await ends_in_motion(site, silent, signal.SIGTERM)


async def ends_in_motion(site: Served, page: Page, number: int) -> None:
    """The server is killed, or ends, while its page drives."""
    await page.drive(0.0)
    await page.press(site.moves, vx=0.3)

    async def hold() -> None:
        with suppress(Exception):
            await page.hold(lambda: False, vx=0.3)

    holding = asyncio.create_task(hold())
    site.web.process.send_signal(number)
    await asyncio.to_thread(site.web.process.wait)
    await eventually(site.stands)
    await holding


async def test_frames_that_queued_while_the_server_was_frozen_move_nothing_nor_does_its_end(
    served: Any,
) -> None:
    site = await served()
    page = await site.driving()
    site.web.process.send_signal(signal.SIGSTOP)
    # The thumb stays down; its messages wait in the server's socket.
    await page.hold(site.stands, vx=0.3)
    for _ in range(20):
        await page.drive(0.3)
        await asyncio.sleep(0.05)
    page.came.clear()
    site.web.process.send_signal(signal.SIGCONT)
    refused = await page.one("refused")
    assert refused["why"] in {"late", "lapse", "let_go", "no_source"}
    await site.stays(page)
    await ends_in_motion(site, page, signal.SIGKILL)


@pytest.mark.nightly
async def test_frames_that_piled_up_in_the_network_move_nothing(served: Any) -> None:
    """Beats went on to arrive, so that the last frames of the pile are fresh; and still."""
    site = await served()
    relay = StalledRelay(f"tcp/127.0.0.1:{site.port}")
    try:
        page = await site.driving(int(relay.endpoint.rpartition(":")[2]))
        relay.stall()
        await page.hold(site.stands, vx=0.3)
        for _ in range(20):
            await page.drive(0.3)
            await asyncio.sleep(0.05)
        relay.flow()
        await page.one("refused", why="lapse")
        await site.stays(page)
        await page.drive(0.0)
        await page.press(site.moves, vx=0.3)
        await page.drive(0.0)
    finally:
        relay.close()


async def released(page: Page) -> bool:
    """Ask for the release of the emergency stop; whether it was done."""
    number = len(page.of("answer")) + 100
    await page.send(type="request", id=number, do="release")
    return bool((await page.one("answer", id=number))["ok"])


@pytest.mark.nightly
async def test_a_thumb_that_is_down_while_the_emergency_stop_is_released_moves_nothing(
    served: Any,
) -> None:
    site = await served()
    page = await site.driving()
    await page.send(type="estop", id=1)
    answer = await page.one("answer", id=1)
    assert answer["ok"]
    assert "by the page" in answer["text"]
    await page.hold(
        lambda: site.stands() and any(each["why"] == "estop" for each in page.of("refused"))
    )
    while not await released(page):
        await page.drive(0.3)
        await asyncio.sleep(0.05)
    await eventually(lambda: page.of("status")[-1]["sample"]["state"] == "standing")
    await page.drive(0.3)
    await site.stays(page)
