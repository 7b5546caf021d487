"""A stop of a fleet under its access rules, on real routers, with robots that lie or are silent."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager

import pytest
import zenoh
from fleet_bench import LATE, ROBOTS, STANDS, FleetBench, RecordingRobot
from zenoh_fixtures import eventually

from yahboomd.cli.main import main
from yahboomd.core.clock import SystemClock
from yahboomd_fleet.fleet_list import FleetList, read_list
from yahboomd_fleet.fleet_stop import FleetStop
from yahboomd_fleet.stop_all import StopAll

pytestmark = pytest.mark.realtime

ONE, TWO, THREE = ROBOTS.values()
HERE = [ONE, TWO, THREE]


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FleetBench]:
    made = FleetBench(tmp_path_factory.mktemp("fleet"))
    try:
        made.start()
        made.settled()
        yield made
    finally:
        made.close()


@pytest.fixture
def fleet(bench: FleetBench) -> Iterator[FleetBench]:
    """All robots answer, and show their tokens."""
    for robot in bench.robots.values():
        robot.answer = STANDS
        robot.live()
    yield bench
    for robot in bench.robots.values():
        robot.leave()


def listed(bench: FleetBench, robots: list[str]) -> FleetList:
    whole = read_list(bench.file("people/vera"))
    return FleetList(person="vera", role="viewer", ways=whole.ways, robots=robots)


@asynccontextmanager
async def stopping(
    bench: FleetBench, robots: list[str]
) -> AsyncIterator[tuple[FleetStop, asyncio.Task[None]]]:
    progress, told = FleetStop(robots), list[str]()
    papers = bench.file("people/vera")
    stop = StopAll(listed(bench, robots), papers, progress, told.append, SystemClock())
    task = asyncio.create_task(stop.run())
    try:
        yield progress, task
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def test_every_robot_is_stopped_and_acknowledges_under_the_rules_of_a_viewer(
    fleet: FleetBench,
) -> None:
    async with stopping(fleet, HERE) as (progress, task):
        await task
    assert progress.all_stand
    assert set(progress.robots) == set(HERE)
    by = '{"by":"vera, yahboomd fleet stop"}'
    for robot in fleet.robots.values():
        assert ("farm/yahboomd/estop", by) in robot.heard
        # By her own key, so that the robot records who stopped it.
        await eventually(lambda: ("farm/*/*/yahboomd/estop/by/vera", by) in robot.heard)  # noqa: B023


@pytest.mark.nightly
async def test_a_robot_that_does_not_answer_and_one_that_is_not_there_are_named_until_the_end(
    fleet: FleetBench,
) -> None:
    silent = fleet.robots["bot2"]
    silent.answer = ""
    async with stopping(fleet, [*HERE, LATE]) as (progress, task):
        await eventually(lambda: set(progress.missing) == {TWO, LATE})
        before = silent.asked
        # It is asked again and again.
        await eventually(lambda: silent.asked > before + 1 and progress.robots[TWO].present)
        assert progress.report()[1:] == [
            f"{TWO}: did not answer, although its daemon is there.",
            f"{LATE}: is not reachable.",
        ]
        assert not task.done()
    # Once it has ended nobody repeats it.
    fleet.flushed("flush the end", "top")
    asked = silent.asked
    fleet.flushed("flush again", "top")
    assert silent.asked == asked


def lie(query: zenoh.Query) -> None:
    for key in (f"{ONE}/yahboomd/estop", str(query.key_expr)):
        try:
            query.reply(key, STANDS)
        except zenoh.ZError:
            continue
    query.drop()


@pytest.mark.nightly
async def test_a_router_that_dies_in_the_middle_is_gone_round_and_waited_for(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """Without the router above, each site is reached by its own."""
    bench = FleetBench(tmp_path_factory.mktemp("dying"))
    try:
        bench.start()
        bench.settled()
        for robot in bench.robots.values():
            robot.answer = STANDS
        bench.robots["bot3"].answer = ""
        async with stopping(bench, HERE) as (progress, task):
            await eventually(lambda: progress.missing == [THREE])
            await asyncio.to_thread(bench.routers["top"].close)
            bench.robots["bot3"].answer = STANDS
            await task
        assert progress.all_stand
    finally:
        bench.close()


def test_the_command_prints_the_result_and_ends_by_it(
    fleet: FleetBench, capsys: pytest.CaptureFixture[str]
) -> None:
    late = RecordingRobot(fleet, "bot4")
    late.answer = STANDS
    assert main(["fleet", "stop", "--fleet", str(fleet.file("people/vera"))]) == 0
    first, result = capsys.readouterr().out.splitlines()
    assert first == "Stopping 4 robots. Ctrl-C ends it."
    assert result.startswith("4 of 4 robots acknowledged, the last after ")
    assert result.endswith(" s; 4 stand.")
    late.sessions[0].close()
