"""Pages on real sockets, with what looks like a daemon behind the server."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import daemon_samples
import msgspec
import pytest
from web_site import ZERO
from websockets.exceptions import ConnectionClosed
from zenoh_fixtures import eventually, free_endpoint

from yahboomd.core.model import Cause
from yahboomd.web import page_commands
from yahboomd.web.page_hub import FULL, MAX_PAGES, MAX_VIEWERS, POLICY, SESSION_ENDED
from yahboomd.web.page_session import RequestFrame, Tool

pytestmark = pytest.mark.realtime


async def test_a_page_gets_the_robot_beats_and_the_newest_samples(
    fake_daemon: Any, site: Any
) -> None:
    daemon = await fake_daemon()
    served = await site(daemon)
    page = await served.page()
    hello = page.of("hello")[0]
    assert (hello["role"], hello["lapse_ms"]) == ("driver", 300)
    assert hello["battery_curve"] == []
    assert (await page.one("daemon"))["alive"]
    for kind in ("pose", "twist", "wheels", "battery", "status"):
        assert "stamp_ns" in (await page.one(kind))["sample"]
    beats = [each["beat"] for each in page.of("beat")]
    # Of two that waited for the page it gets the newer one.
    assert beats == sorted(set(beats))
    daemon.tell("A wheel fell off.")
    await eventually(lambda: page.of("event"))
    assert page.of("event")[0]["sample"]["message"] == "A wheel fell off."
    # One that comes later learns of it, too.
    later = await served.page()
    known = (await later.one("events"))["samples"]
    assert [each["message"] for each in known] == ["A wheel fell off."]
    # How slow its network is, a page knows before it drives.
    beat = page.beat
    await eventually(lambda: page.beat >= beat + 10)
    await page.send(type="seen", beat=beat)
    assert 300 <= (await page.one("delay", beat=beat))["age_ms"] < 20_000


async def test_a_page_learns_before_a_touch_that_the_daemon_takes_none_of_its_commands(
    fake_daemon: Any, site: Any
) -> None:
    daemon = await fake_daemon(config={"command": {"sources": {"cmd_vel": {"priority": 10}}}})
    page = await (await site(endpoint=daemon.endpoint)).page()
    await eventually(lambda: page.of("hello")[-1]["barred"])
    words = page.of("hello")[-1]["barred"]
    assert "its configuration has no source cmd_vel/web" in words


async def test_a_page_drives_and_its_zeros_arrive_and_nothing_after_them(
    fake_daemon: Any, site: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    daemon = await fake_daemon()
    page = await (await site(daemon)).driver()
    await page.press(lambda: len(daemon.velocities) >= 5)
    # Its zeros count for this time after motion.
    monkeypatch.setattr(page_commands, "ZEROS_NS", 60_000_000_000)
    await page.drive(0.0)
    await eventually(lambda: daemon.velocities[-1] == ZERO)
    sent = len(daemon.velocities)
    assert set(daemon.velocities[:-1]) <= {(0.2, 0.0), ZERO}
    command = daemon.commands[0]
    assert command["source"] == "the page"
    assert command["stamp_ns"] > 1e18
    await page.drive(0.0)
    await eventually(lambda: len(daemon.velocities) > sent)
    assert set(daemon.velocities[sent:]) == {ZERO}
    assert (await page.one("control", mine=True))["page_driver"] == 1


async def test_a_command_without_a_fresh_beat_of_this_connection_moves_nothing(
    fake_daemon: Any, site: Any
) -> None:
    daemon = await fake_daemon()
    served = await site(daemon)
    page = await served.driver()
    await eventually(lambda: page.beat >= 0)
    old = page.beat
    await eventually(lambda: page.beat > old + 8)
    for beat in (old, 0, page.beat + 1000):
        await page.drive(beat=beat)
        refused = await page.one("refused")
        assert refused["why"] == "late"
        assert "too slow to drive safely" in refused["text"]
        await page.drive(0.0)
        page.came.clear()
        await asyncio.sleep(0.21)
    assert page.of("refused") == []
    # A beat of before it connected.
    other = await served.driver()
    await other.drive(beat=page.of("beat")[0]["beat"])
    assert (await other.one("refused", why="late"))["what"] == "drive"
    assert (0.2, 0.0) not in daemon.velocities[1:]


async def test_a_page_that_falls_silent_or_is_closed_stops_the_robot(
    fake_daemon: Any, site: Any
) -> None:
    daemon = await fake_daemon()
    served = await site(daemon)
    page, watching = await served.driver(), await served.page()
    await page.press(lambda: daemon.velocities)
    # It may have fallen silent, and pressed again, before.
    await eventually(lambda: not served.hub._commands._moving)
    refused = await page.one("refused", why="lapse")
    assert "robot was stopped" in refused["text"]
    await eventually(lambda: daemon.velocities[-1] == ZERO)
    moved = daemon.velocities.count((0.2, 0.0))
    await page.hold(lambda: page.of("refused")[-1]["why"] == "let_go")
    assert daemon.velocities.count((0.2, 0.0)) == moved
    await page.drive(0.0)
    await page.press(lambda: daemon.velocities.count((0.2, 0.0)) > moved)
    page.socket.transport.abort()
    await watching.one("control", page_driver=None)
    await eventually(lambda: daemon.velocities[-1] == ZERO)
    assert watching.of("refused") == []


async def test_one_page_drives_and_another_takes_over_deliberately(
    fake_daemon: Any, site: Any
) -> None:
    daemon = await fake_daemon()
    served = await site(daemon)
    first, second = await served.driver(), await served.page()
    await first.press(lambda: daemon.velocities)
    await second.drive(0.1)
    assert "Take control" in (await second.one("refused", why="not_yours"))["text"]
    await second.drive(0.0)
    await second.send(type="control", want=True)
    displaced = await first.one("control", mine=False, page_driver=2)
    assert displaced["type"] == "control"
    await eventually(lambda: daemon.velocities[-1] == ZERO)
    await second.press(lambda: (0.1, 0.0) in daemon.velocities, vx=0.1)
    await first.refused("not_yours", vx=0.2, vy=0.0, wz=0.0)
    await second.send(type="control", want=False)
    await second.one("control", page_driver=None)


async def test_of_two_pages_that_touch_at_once_the_first_keeps_control(
    fake_daemon: Any, site: Any
) -> None:
    """Neither knows yet that the other one has it."""
    daemon = await fake_daemon()
    served = await site(daemon)
    first, second = await served.page(), await served.page()
    for page, vx in ((first, 0.2), (second, 0.1)):
        await page.send(type="control", want=True, if_free=True)
        await page.drive(vx)
    await second.one("refused", why="not_yours")
    await first.press(lambda: daemon.velocities.count((0.2, 0.0)) > 3)
    assert first.of("control")[-1]["mine"]
    assert (0.1, 0.0) not in daemon.velocities


async def test_a_viewer_watches_and_stops_but_neither_drives_nor_releases(
    fake_daemon: Any, site: Any
) -> None:
    daemon = await fake_daemon()
    served = await site(daemon, phones=True)
    page = await served.page("viewer")
    assert page.of("hello")[0]["role"] == "viewer"
    await page.one("pose")
    await page.drive()
    await page.one("refused", why="viewer")
    await page.send(type="control", want=True)
    for number, what in enumerate(("release", "set_pose", "reset_odometry")):
        await page.send(type="request", id=number, do=what)
        assert not (await page.one("answer", id=number))["ok"]
    assert daemon.asked == []
    await page.send(type="estop", id=9)
    answer = await page.one("answer", id=9)
    assert answer["ok"]
    assert answer["text"] == "The emergency stop is engaged."
    assert daemon.asked == ["yahboomd/estop"]
    assert daemon.velocities == []
    assert all(each["page_driver"] is None for each in page.of("control"))


async def test_the_driver_releases_and_is_answered_in_the_daemons_words(
    fake_daemon: Any, site: Any
) -> None:
    daemon = await fake_daemon()
    page = await (await site(daemon)).driver()
    await page.send(type="request", id=1, do="release")
    assert (await page.one("answer", id=1))["text"] == "Released."
    daemon.releases = False
    await page.send(type="request", id=2, do="release")
    assert not (await page.one("answer", id=2))["ok"]
    await page.send(type="request", id=3, do="fly")
    assert not (await page.one("answer", id=3))["ok"]


async def test_a_drivers_page_without_control_changes_nothing_while_another_has_it(
    fake_daemon: Any, site: Any
) -> None:
    daemon = await fake_daemon()
    served = await site(daemon)
    driver, other = await served.driver(), await served.page()
    for number, what in enumerate(("release", "set_pose", "reset_odometry")):
        await other.send(type="request", id=number, do=what)
        answer = await other.one("answer", id=number)
        assert not answer["ok"]
        assert "Take control" in answer["text"]
    assert daemon.asked == []
    await driver.send(type="control", want=False)
    await other.one("control", page_driver=None, mine=False)
    await other.send(type="request", id=3, do="release")
    assert (await other.one("answer", id=3))["ok"]


async def test_what_a_page_asked_in_the_instant_its_session_ended_is_not_done(
    fake_daemon: Any, site: Any
) -> None:
    """A calibration would have begun, with control, for a page that is not there."""
    daemon = await fake_daemon()
    served = await site(daemon, phones=True)
    watching = await served.page("driver", "Bert")
    page = await served.page("driver", "Anne")
    (known,) = (each for each in served.hub._pages.values() if each.name == "Anne")
    for frame in (
        Tool(id=1, do="calibrate", args={"verb": "squares", "choices": {}}),
        RequestFrame(id=2, do="release"),
    ):
        served.hub._handle(known, frame)
    asked = list(known.requests)
    await served.sessions.end(known.phone)
    await asyncio.gather(*asked, return_exceptions=True)
    assert await page.close_code() == SESSION_ENDED
    assert served.hub._commands.driver is None
    assert served.hub.tools.calibration.page is None
    assert daemon.asked == []
    await watching.send(type="control", want=True, if_free=True)
    await watching.one("control", mine=True)


async def test_while_the_robot_may_not_move_a_page_learns_the_daemons_reason(
    fake_daemon: Any, site: Any
) -> None:
    """And has to let go before it moves again, so that a release moves nothing."""
    daemon = await fake_daemon()
    page = await (await site(daemon)).driver()
    stopped = daemon_samples.status("estopped", driver=None, why="Anne stopped it. Type `x`.")
    reasons = Cause("estop", "Anne stopped it."), Cause("release", "Type `x`.")
    daemon.status = msgspec.structs.replace(stopped, reasons=reasons)
    await page.one("status")
    await eventually(lambda: page.of("status")[-1]["sample"]["state"] == "estopped")
    await page.hold(lambda: any(each["why"] == "estop" for each in page.of("refused")))
    told = (await page.one("refused", why="estop"))["text"]
    assert told == "The robot cannot drive. Anne stopped it.", "no command for a terminal"
    before = len(daemon.velocities)
    daemon.status = daemon_samples.status("standing", driver=None, why="At rest.")
    await page.hold(lambda: page.of("refused")[-1]["why"] == "let_go")
    assert len(daemon.velocities) == before


async def test_without_a_daemon_the_page_says_so_and_comes_back_by_itself(
    fake_daemon: Any, site: Any
) -> None:
    endpoint = free_endpoint()
    served = await site(endpoint=endpoint)
    page = await served.driver()
    assert not (await page.one("daemon"))["alive"]
    await page.drive()
    assert "No yahboomd answers at tcp" in (await page.one("refused", why="no_daemon"))["text"]
    await page.drive(0.0)
    await page.send(type="estop", id=1)
    assert not (await page.one("answer", id=1))["ok"]
    status, _, body = await served.request("POST", "/estop")
    assert (status, json.loads(body)["engaged"]) == (503, False)
    assert "Switch the motors' supply off" in json.loads(body)["text"]
    daemon = await fake_daemon(endpoint=endpoint)
    await page.one("daemon", alive=True)
    await eventually(lambda: served.hub.robot.obstacle() is None)
    await page.press(lambda: daemon.velocities)
    await daemon.stop()
    await eventually(lambda: not page.of("daemon")[-1]["alive"])
    # Its token goes before its router.
    await eventually(lambda: "is lost; it reconnects" in page.of("daemon")[-1]["text"])


async def test_a_page_that_sends_too_much_or_no_frame_is_closed_but_its_estop_counts(
    fake_daemon: Any, site: Any
) -> None:
    daemon = await fake_daemon()
    served = await site(daemon)
    flooding = await served.page()
    with pytest.raises(ConnectionClosed):  # noqa: PT012
        while True:
            await flooding.send(type="seen", beat=1)
            await asyncio.sleep(0)
    assert await flooding.close_code() == POLICY
    stopping = await served.page()
    for number in range(1000):
        await stopping.send(type="estop", id=number)
    assert (await stopping.one("answer"))["ok"]
    # However many ask, few questions are sent.
    assert len(daemon.asked) < 100
    for frame in ("", "[]", '{"type":"drive"}', "nonsense"):
        broken = await served.page()
        await broken.socket.send(frame)
        assert await broken.close_code() == POLICY
    binary = await served.page()
    await binary.socket.send(b"\x00\x01")
    assert await binary.close_code() == POLICY
    large = await served.page()
    await large.socket.send("x" * 4096)
    assert await large.close_code() == 1009
    assert not daemon.velocities


async def test_there_are_so_many_pages_and_no_more_and_the_estop_works_beside_them(
    fake_daemon: Any, site: Any
) -> None:
    daemon = await fake_daemon()
    served = await site(daemon)
    pages = [await served.page() for _ in range(MAX_PAGES)]
    refused = await served.open()
    assert await refused.close_code() == FULL
    status, _, body = await served.request("POST", "/estop")
    assert status == 200
    assert b'"engaged":true' in body
    assert daemon.asked == ["yahboomd/estop"]
    await pages[0].close()
    await pages[1].send(type="control", want=True)
    await pages[1].one("control", mine=True)
    await pages[1].press(lambda: daemon.velocities)
    await served.page()


async def test_however_many_viewers_watch_a_drivers_page_finds_room(
    fake_daemon: Any, site: Any
) -> None:
    daemon = await fake_daemon()
    served = await site(daemon, phones=True)
    for _ in range(MAX_VIEWERS):
        await served.page("viewer")
    assert (
        await (await served.open(additional_headers=served.cookie("viewer"))).close_code() == FULL
    )
    await served.driver()
