"""Robots are asked over real routers, those of `yahboomd fleet init` and one without rules."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager

import daemon_samples
import msgspec
import pytest
import zenoh
from zenoh.handlers import Callback

pytest.importorskip("cryptography")

from fleet_bench import LATE, ROBOTS, FleetBench
from zenoh_fixtures import eventually, free_endpoint

from yahboomd.cli.main import main
from yahboomd.core.bus.options import BusOptions, zenoh_config
from yahboomd.core.clock import SystemClock
from yahboomd.core.messages.codecs import encode
from yahboomd.core.messages.native import ServiceReply
from yahboomd.tools.fleet.fleet_feed import MOST_BYTES, FleetFeed
from yahboomd.tools.fleet.fleet_list import FleetList, read_list
from yahboomd.tools.fleet.fleet_view import MOST_UNLISTED, FleetView, RobotRow

pytestmark = pytest.mark.realtime

ONE, TWO, THREE = ROBOTS.values()
STANDING = encode(daemon_samples.status("standing", driver=None, bus={"zid": "a"}), "json")
CONFIG = encode(
    ServiceReply(
        success=True,
        message="",
        data={"version": "0.9", "chassis": {"wheel_separation_multiplier": 1.5}},
    ),
    "json",
)


@asynccontextmanager
async def looking(
    fleet: FleetList, bench: FleetBench | None, who: str = ""
) -> AsyncIterator[FleetFeed]:
    papers = None if bench is None else bench.file(f"people/{who}")
    feed = FleetFeed(fleet, papers, FleetView(fleet.robots), SystemClock())
    task = asyncio.create_task(feed.run())
    try:
        yield feed
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


def rows(feed: FleetFeed) -> dict[str, RobotRow]:
    return {row.robot: row for row in feed.view.rows(feed.clock.now_ns())}


def driving(feed: FleetFeed) -> list[str]:
    """The versions of the robots that can drive."""
    return [row.version for row in rows(feed).values() if row.can_drive]


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FleetBench]:
    made = FleetBench(tmp_path_factory.mktemp("fleet"))
    try:
        made.start()
        made.settled()
        for robot in made.robots.values():
            robot.answers = {"yahboomd/status": STANDING, "yahboomd/config": CONFIG}
            robot.live()
        yield made
    finally:
        made.close()


async def test_a_viewer_sees_every_robot_of_the_list_and_a_maintainer_its_calibration_too(
    bench: FleetBench,
) -> None:
    for who, version in (("vera", ""), ("max", "0.9")):
        async with looking(read_list(bench.file(f"people/{who}")), bench, who) as feed:
            versions = 3 * [version]
            await eventually(lambda: driving(feed) == versions)  # noqa: B023
            found = rows(feed)
            assert [*found] == [LATE, ONE, TWO, THREE]
            assert found[LATE].needs == "not reachable"
            assert found[ONE].calibrated is (True if version else None)


def test_the_command_waits_for_every_robot_of_the_list_and_ends_by_it(
    bench: FleetBench, capsys: pytest.CaptureFixture[str]
) -> None:
    papers = str(bench.file("people/max"))
    assert main(["fleet", "status", "--fleet", papers, "--json"]) == 1
    found = msgspec.json.decode(capsys.readouterr().out, type=list[RobotRow])
    assert [row.robot for row in found if row.needs] == [LATE]
    assert {row.version for row in found if row.can_drive} == {"0.9"}


async def test_without_the_router_above_each_site_is_asked_by_its_own(bench: FleetBench) -> None:
    whole = read_list(bench.file("people/vera"))
    top, *sites = whole.ways
    nobody = f"tls/{free_endpoint().removeprefix('tcp/')}"
    ways = {nobody: whole.ways[top]} | {site: whole.ways[site] for site in sites}
    async with looking(msgspec.structs.replace(whole, ways=ways), bench, "vera") as feed:
        await eventually(lambda: sum(row.can_drive for row in rows(feed).values()) == 3)


async def test_a_liar_with_a_robots_certificate_changes_its_own_row_alone(
    bench: FleetBench,
) -> None:
    liar = bench.robots["bot2"].sessions[0]
    lie = encode(daemon_samples.status("fault", why="A lie."), "json")

    def answer(query: zenoh.Query) -> None:
        for key in (f"{ONE}/yahboomd/status", f"{THREE}/yahboomd/status", f"{TWO}/yahboomd/status"):
            try:
                query.reply(key, lie)
            except zenoh.ZError:
                continue
        query.drop()

    bench.robots["bot2"].answers = {}
    lying = liar.declare_queryable("farm/*/*/yahboomd/status", Callback(answer, indirect=False))
    own = liar.declare_queryable(f"{TWO}/yahboomd/status", Callback(answer, indirect=False))
    fakes = [
        liar.liveliness().declare_token(f"{place}{number}/yahboomd/alive/{number}")
        for place in ("farm/north/fake", f"{TWO}/fake")
        for number in range(300)
    ]
    fakes.append(liar.liveliness().declare_token(f"{TWO}/yahboomd/alive/last"))
    async with looking(read_list(bench.file("people/vera")), bench, "vera") as feed:
        await eventually(lambda: rows(feed)[TWO].needs == "fault" and rows(feed)[ONE].can_drive)
        found = rows(feed)
        assert found[THREE].why != "A lie."
        # Below its own namespace it may pretend whatever it wants: it is in no place of robots.
        assert [*found] == [TWO, LATE, ONE, THREE]
    for each in (lying, own, *fakes):
        each.undeclare()
    bench.robots["bot2"].answers = bench.robots["bot1"].answers


OLDER = {
    "stamp_ns": 1,
    "state": "standing",
    "driver": None,
    "since_ns": 1,
    "why": "At rest.",
    **{group: {} for group in ("board", "link", "command", "bus")},
}
"""A status of version 0.1 with nothing that came later."""

NEWER = {
    **OLDER,
    "state": "parked",
    "mood": [1, {"sunny": True}],
    "board": {"volts": 12.0, "cells": [4.0, [4.1]], "battery": "splendid"},
    "bus": {"zid": "c", "peers": {"a": {"b": {"c": {"d": {"e": 1}}}}}},
}
"""One of a later version: a state, fields and shapes that this one does not know."""


async def test_robots_of_an_older_and_of_a_later_version_are_both_there() -> None:
    endpoint = free_endpoint()
    with zenoh.open(zenoh_config(BusOptions(listen=(endpoint,), connect=()))) as router:
        for name, facts in (("old", OLDER), ("new", NEWER)):
            key, payload = f"{name}/yahboomd/status", msgspec.json.encode(facts)

            def answer(query: zenoh.Query, key: str = key, payload: bytes = payload) -> None:
                query.reply(key, payload)
                query.drop()

            router.declare_queryable(key, Callback(answer, indirect=False))
        fleet = FleetList(person="", role="maintainer", ways={endpoint: [""]}, robots=[])
        async with looking(fleet, None) as feed:
            await eventually(lambda: [*rows(feed)] == ["new", "old"])
            found = rows(feed)
    assert (found["old"].needs, found["old"].can_drive) == ("", True)
    # Whoever does not know its state does not claim that it may drive.
    assert (found["new"].needs, found["new"].can_drive) == ("unknown state", False)
    assert (found["new"].state, found["new"].volts) == ("parked", 12.0)


async def test_a_flood_of_robots_of_no_list_leaves_the_listed_one_and_a_number() -> None:
    """Without access rules: tokens and answers of thousands that do not exist."""
    endpoint = free_endpoint()
    options = BusOptions(listen=(endpoint,), connect=())
    with zenoh.open(zenoh_config(options)) as router:

        def answer(query: zenoh.Query) -> None:
            for number in range(3000):
                query.reply(f"f\x1b[2J{number}/yahboomd/status", STANDING)
            for payload in (b"\xff" * 40, b"{", b'{"state": 3}', b"x" * (MOST_BYTES + 1), STANDING):
                query.reply("mine/yahboomd/status", payload)
            query.drop()

        router.declare_queryable("**", Callback(answer, indirect=False))
        tokens = [
            router.liveliness().declare_token(f"fake{number}/yahboomd/alive/1")
            for number in range(1000)
        ]
        fleet = FleetList(person="", role="viewer", ways={endpoint: [""]}, robots=["mine"])
        async with looking(fleet, None) as feed:
            await eventually(lambda: rows(feed)["mine"].can_drive and feed.view.left_out > 2000)
            assert len(rows(feed)) == MOST_UNLISTED + 1
        del tokens


async def test_whatever_else_is_due_comes_between_two_answers() -> None:
    """The server of a page drives a robot meanwhile: no flood of answers delays its commands."""
    fleet = FleetList(person="", role="viewer", ways={}, robots=[f"bot{n}" for n in range(100)])
    feed = FleetFeed(fleet, None, FleetView(fleet.robots), SystemClock())
    feed._answers = {f"{robot}/yahboomd/status": STANDING for robot in fleet.robots}
    turns = []

    async def command() -> None:
        while True:
            turns.append(len(driving(feed)))
            await asyncio.sleep(0)

    task = asyncio.create_task(command())
    await feed._read_all()
    task.cancel()
    assert turns[-100:] == [*range(turns[-1] - 99, turns[-1] + 1)]
