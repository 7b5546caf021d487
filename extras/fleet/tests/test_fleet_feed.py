"""Robots are asked over real routers, those of `yahboomd fleet init` and one without rules."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager

import daemon_samples
import msgspec
import pytest
from fleet_bench import LATE, ROBOTS, FleetBench
from zenoh_fixtures import eventually

from yahboomd.cli.main import main
from yahboomd.core.clock import SystemClock
from yahboomd.core.messages.codecs import encode
from yahboomd.core.messages.native import ServiceReply
from yahboomd_fleet.fleet_feed import FleetFeed
from yahboomd_fleet.fleet_list import FleetList, read_list
from yahboomd_fleet.fleet_view import FleetView, RobotRow

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
