"""A page holds a place of the map: the robot goes there while it does, and no longer."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable
from typing import Any

import daemon_samples
import pytest
from fake_moves import FakeMoves
from web_site import Page, Site
from zenoh_fixtures import eventually

from yahboomd.client import robot_moves
from yahboomd.client.move_messages import CANCEL, START
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.options import BusOptions
from yahboomd.web import page_commands
from yahboomd.web.page_moves import move_to
from yahboomd.web.page_session import Go

realtime = pytest.mark.realtime

PLACE = {"x": 2.5, "y": -0.25, "turn": False, "speed_m_s": 0.2, "turn_rad_s": 9.0}


class Bench:
    """A daemon's samples, a service of moves, and the page's server."""

    def __init__(self, daemon: Any, served: FakeMoves, site: Site) -> None:
        self.daemon = daemon
        self.served = served
        self.site = site

    async def hold(self, page: Page, until: Callable[[], Any], **place: Any) -> Any:
        """Hold a place until something is true; again if this machine was too busy."""
        refused = len(page.of("refused"))
        while not (found := until()):
            if len(page.of("refused")) > refused:
                refused = len(page.of("refused"))
                await page.drive(0.0)
            await self.once(page, **place)
            await asyncio.sleep(0.05)
        return found

    async def once(self, page: Page, **place: Any) -> None:
        await eventually(lambda: page.beat >= 0)
        await page.send(type="go", beat=page.beat, **{**PLACE, **place})

    async def going(self) -> Page:
        """A page that holds, and whose move runs."""
        page = await self.site.driver()
        await page.one("pose")
        beats = len(self.served.beats)
        await self.hold(page, lambda: len(self.served.beats) > beats)
        return page


@pytest.fixture
async def bench(
    fake_daemon: Callable[..., Any],
    site: Callable[..., Awaitable[Site]],
    monkeypatch: pytest.MonkeyPatch,
) -> Any:
    monkeypatch.setattr(robot_moves, "SERVICE_S", 60.0)
    monkeypatch.setattr(robot_moves, "ASK_S", 60.0)
    daemon = await fake_daemon()
    bus = Bus(BusOptions(listen=(), connect=(daemon.endpoint,)))
    await bus.open()
    served = FakeMoves(bus)
    made = await site(daemon, phones=True)
    await eventually(lambda: made.hub.robot.has_moves)
    yield Bench(daemon, served, made)
    await bus.close()


@realtime
async def test_what_is_held_becomes_a_move_and_each_of_its_messages_one_beat(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A machine that is busy for a moment ends no hold.
    monkeypatch.setattr(page_commands, "LAPSE_NS", 60_000_000_000)
    page = await bench.going()
    beats = len(bench.served.beats)
    for number in range(1, 4):
        await bench.once(page)
        await eventually(lambda beats=beats + number: len(bench.served.beats) == beats)
    (request,) = bench.served.requests
    (move,) = request["moves"]
    assert move == {"kind": "go_to", "x": 2.5, "y": -0.25, "speed_m_s": 0.2, "turn_rad_s": 1.5}
    assert request["by"] == "the page"
    assert bench.served.tokens == {request["holder"]}
    await page.drive(0.0)
    await eventually(lambda: CANCEL in bench.served.asked)
    await eventually(lambda: not bench.served.tokens)
    assert (await page.one("move", state="ended"))["message"] == "You let go: the robot stops."
    # Nothing of it is commanded by the page itself.
    assert bench.daemon.velocities == []


async def lift(bench: Bench, page: Page) -> None:
    await page.drive(0.0)


async def leave(bench: Bench, page: Page) -> None:
    page.socket.transport.abort()


async def say_nothing(bench: Bench, page: Page) -> None:
    pass


async def give_way(bench: Bench, page: Page) -> None:
    other = await bench.site.page()
    await other.send(type="control", want=True)


async def touch_the_joystick(bench: Bench, page: Page) -> None:
    await page.drive(0.2)


async def end_the_server(bench: Bench, page: Page) -> None:
    bench.site.hub.stop()


async def engage_the_stop(bench: Bench, page: Page) -> None:
    why = "Anne pressed the button."
    bench.daemon.status = daemon_samples.status("estopped", driver=None, why=why)
    await bench.hold(page, lambda: any(each["why"] == "estop" for each in page.of("refused")))


@realtime
@pytest.mark.parametrize(
    "loss",
    [
        leave,
        say_nothing,
        end_the_server,
        *(
            pytest.param(loss, marks=pytest.mark.nightly)
            for loss in (lift, give_way, touch_the_joystick, engage_the_stop)
        ),
    ],
)
async def test_whatever_ends_the_hold_ends_the_move(
    bench: Bench, loss: Callable[[Bench, Page], Awaitable[None]]
) -> None:
    page = await bench.going()
    await loss(bench, page)
    await eventually(lambda: CANCEL in bench.served.asked)
    await eventually(lambda: not bench.served.tokens)
    beats = len(bench.served.beats)
    if loss in {say_nothing, touch_the_joystick}:
        # Of a page that is still there: it has to let go first.
        asked = bench.served.asked.count(START)
        while not any(each["why"] == "let_go" for each in page.of("refused")):
            await bench.once(page)
            await asyncio.sleep(0.05)
        assert bench.served.asked.count(START) == asked
    assert len(bench.served.beats) == beats


@realtime
async def test_a_viewer_a_page_without_control_and_an_old_beat_begin_no_move(bench: Bench) -> None:
    viewer = await bench.site.page("viewer")
    page, other = await bench.site.driver(), await bench.site.page()
    await eventually(lambda: len(page.of("beat")) > 20)
    await viewer.refused("viewer", "go", **PLACE)
    await other.refused("not_yours", "go", **PLACE)
    await page.send(type="go", beat=page.of("beat")[0]["beat"], **PLACE)
    assert "too slow to drive safely" in (await page.one("refused", why="late"))["text"]
    assert bench.served.asked == []


@realtime
async def test_progress_and_the_sentence_of_the_end_reach_every_page(bench: Bench) -> None:
    page = await bench.going()
    watching = await bench.site.page("viewer")
    shown = await watching.one("move")
    assert (shown["x"], shown["y"], shown["turn"]) == (2.5, -0.25, False)
    bench.served.tell(done=0.5, left_m=0.4, left_s=1.5)
    await bench.hold(page, lambda: watching.of("move")[-1].get("done") == 0.5)
    bench.served.tell(state="ended", reason="blocked", message="Something is in the way.")
    await bench.hold(page, lambda: watching.of("move")[-1]["state"] == "ended")
    assert watching.of("move")[-1]["message"] == "Something is in the way."
    beats, asked = len(bench.served.beats), list(bench.served.asked)
    # The finger that stays begins nothing.
    for _ in range(6):
        await bench.once(page)
        await asyncio.sleep(0.05)
    assert (len(bench.served.beats), bench.served.asked) == (beats, asked)


@realtime
async def test_without_the_service_the_page_says_so_before_a_touch_and_after_one(
    fake_daemon: Callable[..., Any], site: Callable[..., Awaitable[Site]]
) -> None:
    page = await (await site(await fake_daemon())).driver()
    words = page.of("hello")[-1]["no_moves"]
    assert "`yahboomd moves` does not run" in words
    assert (await page.refused("no_moves", "go", **PLACE))["text"] == words


@realtime
async def test_a_refusal_of_the_service_is_shown_in_its_words(bench: Bench) -> None:
    bench.served.answer = type(bench.served.answer)(success=False, message="A car does not turn.")
    page = await bench.site.driver()
    await page.one("pose")
    await bench.hold(page, lambda: page.of("move")[-1]["state"] == "ended", turn=True)
    assert page.of("move")[-1]["message"] == "A car does not turn."
    (move,) = bench.served.requests[0]["moves"]
    assert move["kind"] == "turn"


@pytest.mark.parametrize(
    ("x", "y", "theta", "degrees"),
    [(0.0, 1.0, 0.0, 90.0), (0.0, -1.0, 0.0, -90.0), (-1.0, -1.0, math.pi, 45.0), (1, 0, 7.0, 0.0)],
)
def test_a_turn_to_a_place_is_the_shorter_one(
    x: float, y: float, theta: float, degrees: float
) -> None:
    pose = daemon_samples.pose(0.0, 0.0, theta)
    move = move_to(Go(beat=1, x=x, y=y, turn=True, speed_m_s=1.0, turn_rad_s=0.5), pose)
    wanted = math.radians(degrees) if theta < 7.0 else 2 * math.pi - 7.0
    assert move.angle_rad == pytest.approx(wanted, abs=1e-9)
    assert (move.speed_m_s, move.turn_rad_s) == (0.3, 0.5)
