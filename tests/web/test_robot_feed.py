"""The robot as pages see it."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import daemon_samples
import pytest
import zenoh
from zenoh_fixtures import eventually

from yahboomd.client.connection import client_options
from yahboomd.core.bus import keys
from yahboomd.core.bus.bus import Bus
from yahboomd.core.clock import SystemClock
from yahboomd.core.config import Config
from yahboomd.core.messages.codecs import encode
from yahboomd.core.messages.native import ServiceReply
from yahboomd.core.model import Twist2d
from yahboomd.web.robot_feed import RobotFeed, curve_of, daemon_part, limits_of, takes

pytestmark = pytest.mark.realtime


class Followed:
    """A feed that runs."""

    def __init__(self, endpoint: str, source: str = "cmd_vel/web") -> None:
        self.changes = 0
        self.events: list[object] = []
        self.feed = RobotFeed(
            client_options(endpoint),
            SystemClock(),
            source,
            changed=self._changed,
            happened=self.events.append,
        )
        self._task = asyncio.create_task(self.feed.run())

    def _changed(self) -> None:
        self.changes += 1

    async def __aenter__(self) -> RobotFeed:
        await eventually(lambda: self.feed.alive and self.feed._publisher)
        return self.feed

    async def __aexit__(self, *_: object) -> None:
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)


async def test_each_sample_is_encoded_once_and_a_broken_one_is_left_out(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    async with Followed(daemon.endpoint) as feed:
        await eventually(lambda: set(feed.fresh()) >= {"pose", "twist", "wheels"})
        known = json.loads(feed.known["pose"])
        assert known["type"] == "pose"
        assert known["sample"]["x"] == 1.5
        await daemon.stop()
        await eventually(lambda: not feed.alive)
        assert feed.known == {}
        assert json.loads(daemon_part(feed))["text"]


async def test_what_is_no_sample_reaches_no_page(fake_daemon: Any) -> None:
    """Any client of the bus may publish on the daemon's keys."""
    daemon = await fake_daemon()
    async with Followed(daemon.endpoint) as feed, Bus(client_options(daemon.endpoint)) as other:
        imu = other.publisher(keys.BATTERY)
        await eventually(lambda: imu.has_subscribers)
        for payload in (b'1},{"type":"estop"', b"\xff\xfe", b"{}", b'{"volts":1}', b"x" * 300_000):
            imu.put(payload)
        found: dict[str, bytes] = {}

        def came() -> bool:
            found.update(feed.fresh())
            return "pose" in found

        await eventually(came)
        for each in found.values():
            json.loads(each)
        if "battery" in found:
            assert json.loads(found["battery"])["sample"]["volts"] == 7.4


async def test_a_key_that_the_daemon_does_not_take_is_named_with_its_remedy(
    fake_daemon: Any,
) -> None:
    daemon = await fake_daemon()
    async with Followed(daemon.endpoint, "cmd_vel/phone") as feed:
        refusal = feed.obstacle()
        assert refusal is not None
        assert refusal.why == "no_source"
        assert "its configuration has no source cmd_vel/phone" in refusal.text
        feed.put(Twist2d(vx=0.1))


async def test_however_many_ask_for_the_estop_few_questions_are_sent(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    async with Followed(daemon.endpoint) as feed:
        first = feed.engage()
        await asyncio.sleep(0)
        later = {feed.engage() for _ in range(1000)}
        assert len(later) == 1
        assert first not in later
        answers = await asyncio.gather(first, *later)
        assert all(answer.success for answer in answers)
        # The second was asked after all who waited for it.
        assert daemon.asked == [keys.ESTOP, keys.ESTOP]
        assert (await feed.engage()).success


async def test_the_driver_of_the_robot_and_its_state_come_from_the_status(
    fake_daemon: Any,
) -> None:
    daemon = await fake_daemon()
    async with Followed(daemon.endpoint) as feed:
        daemon.status = daemon_samples.status("driving", driver="cmd_vel")
        await eventually(lambda: feed.driver == "cmd_vel" and feed.obstacle() is None)


def in_effect(**chassis: object) -> dict[str, Any]:
    config = Config.model_validate({"chassis": chassis, "limits": {"linear": {"velocity": 0.5}}})
    return config.resolved().as_data()


async def test_a_key_that_is_not_configured_is_barred_even_if_others_listen_to_it(
    fake_daemon: Any,
) -> None:
    daemon = await fake_daemon(config={"command": {"sources": {"cmd_vel": {}}}})
    async with Followed(daemon.endpoint) as feed:
        await eventually(lambda: feed.barred)
        refusal = feed.obstacle()
        assert refusal is not None
        assert (refusal.why, refusal.text) == ("no_source", feed.barred)
        daemon.config = {"command": {"sources": {"cmd_vel/web": {}}}}
        await daemon.stop()
        await eventually(lambda: not feed.alive)
        assert feed.barred == ""
        await daemon.start()
        await eventually(lambda: feed.alive and feed.obstacle() is None)


async def test_a_newer_daemon_is_shown_in_a_state_that_no_page_drives_in(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    daemon.payloads = daemon_samples.of_version("newer", "json")
    async with Followed(daemon.endpoint) as feed:
        await eventually(lambda: "status" in feed.known or feed.fresh().get("status"))
        shown = json.loads(feed.known["status"])["sample"]
        assert (shown["state"], shown["board"]["port"]) == ("docked", "/dev/ttyUSB0")
        obstacle = feed.obstacle()
        assert obstacle is not None
        assert "Its state is 'docked'" in obstacle.text
        await eventually(
            lambda: (
                {"pose", "twist", "wheels", "battery"} <= feed.known.keys() | feed.fresh().keys()
            )
        )


async def test_a_daemon_that_does_not_answer_in_time_is_asked_again(fake_daemon: Any) -> None:
    daemon = await fake_daemon(config=None)
    asked: list[object] = []

    def answer(query: zenoh.Query) -> None:
        asked.append(query)
        if len(asked) > 1:
            reply = ServiceReply(success=True, message="", data=in_effect())
            query.reply(query.key_expr, encode(reply, "json"))

    async with Bus(client_options(daemon.endpoint)) as late:
        queryable = late.session.declare_queryable(keys.CONFIG, answer)
        async with Followed(daemon.endpoint) as feed:
            await eventually(lambda: feed.limits)
        queryable.undeclare()
    # A busy machine may answer the second too late as well.
    assert len(asked) >= 2


def test_a_daemon_whose_sources_are_not_known_may_take_any() -> None:
    known = in_effect()
    assert takes(known, "cmd_vel/web")
    assert not takes(known, "cmd_vel/phone")
    for other in ({}, {"command": 3}, {"command": {"sources": ["cmd_vel"]}}):
        assert takes(other, "cmd_vel/phone")


def test_limits_are_those_of_the_configuration_in_effect() -> None:
    assert limits_of(in_effect(preset="4wd")) == {"vx": 0.5, "vy": 0.0, "wz": 6.0}
    assert limits_of(in_effect(preset="mecanum", wheel_base_m=0.2))["vy"] == 0.5
    assert limits_of({"limits": {"linear": {"velocity": "much"}}}) == {}


def test_the_batterys_curve_is_that_of_the_configuration_in_effect() -> None:
    curve = [[9.6, 0.0], [12.6, 1.0]]
    assert curve_of({"board": {"battery_curve": curve}}) == curve
    assert curve_of(in_effect()) == []
    assert curve_of({"board": {"battery_curve": "full"}}) == curve_of({}) == []
