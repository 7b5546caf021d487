"""A stop of a fleet under its access rules, on real routers, with robots that lie or are silent."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager

import msgspec
import pytest
import zenoh
from zenoh.handlers import Callback

pytest.importorskip("cryptography")

from fleet_bench import LATE, ROBOTS, STANDS, TURNS, FleetBench, RecordingRobot
from real_robot import Process
from zenoh_fixtures import PATIENCE_S, eventually

from yahboomd.cli.main import main
from yahboomd.core.bus.presence import TokenChange
from yahboomd.core.clock import SystemClock
from yahboomd.core.errors import BusError
from yahboomd.tools.fleet.fleet_list import FleetList, read_list
from yahboomd.tools.fleet.fleet_stop import FleetStop
from yahboomd.tools.fleet.stop_all import StopAll, StopWay

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
    by = '{"by":"vera, yahboomd stop --all"}'
    for robot in fleet.robots.values():
        assert ("farm/yahboomd/estop", by) in robot.heard
        # By her own key, so that the robot records who stopped it.
        await eventually(lambda: ("farm/*/*/yahboomd/estop/by/vera", by) in robot.heard)  # noqa: B023


async def test_a_name_that_makes_no_key_keeps_no_robot_driving(
    fleet: FleetBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The first sending has to do: without tokens nobody is asked again before this.
    monkeypatch.setattr("yahboomd.tools.fleet.stop_all.AGAIN_S", 3600.0)
    for robot in fleet.robots.values():
        robot.leave()
    nameless = msgspec.structs.replace(listed(fleet, HERE), person="/?")
    papers, progress = fleet.file("people/vera"), FleetStop(HERE)
    stop = StopAll(nameless, papers, progress, print, SystemClock())
    await asyncio.wait_for(stop.run(), PATIENCE_S)
    assert progress.all_stand


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


async def test_a_robot_that_thaws_or_could_not_send_it_at_first_acknowledges_in_the_end(
    fleet: FleetBench,
) -> None:
    frozen, deaf = fleet.robots["bot2"], fleet.robots["bot3"]
    frozen.answer = ""
    deaf.answer = '{"success": false, "message": "The board is not connected."}'
    async with stopping(fleet, HERE) as (progress, task):
        await eventually(
            lambda: progress.missing == [TWO, THREE] and progress.robots[THREE].refusal
        )
        assert not task.done()
        frozen.answer = deaf.answer = STANDS
        await task
    assert progress.all_stand


async def test_wheels_that_turn_are_looked_at_until_they_stand(
    fleet: FleetBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A busy machine may ask late.
    monkeypatch.setattr("yahboomd.tools.fleet.fleet_stop.STAND_WITHIN_S", 60.0)
    robot = fleet.robots["bot3"]
    robot.answer, robot.wheels = TURNS, [0.2, 0.1, 0.0, 0.0, 0.0, 0.0]
    async with stopping(fleet, HERE) as (progress, task):
        await task
    assert progress.all_stand
    assert progress.robots[THREE].fastest_m_s == 0.0
    robot.wheels = []


async def test_a_robot_that_appears_later_is_stopped_too(fleet: FleetBench) -> None:
    async with stopping(fleet, [*HERE, LATE]) as (progress, task):
        await eventually(lambda: progress.missing == [LATE])
        late = RecordingRobot(fleet, "bot4")
        late.answer = STANDS
        late.live()
        await task
        assert late.asked
        late.leave()
        late.sessions[0].close()
    assert progress.all_stand


async def test_a_liar_with_a_robots_certificate_acknowledges_for_no_other_robot(
    fleet: FleetBench,
) -> None:
    fleet.robots["bot1"].answer = ""
    with fleet.person("robots/bot2", "north") as near, fleet.person("robots/bot3", "top") as far:
        for liar in (near, far):
            for key in (f"{ONE}/yahboomd/estop", "farm/*/*/yahboomd/estop", "farm/yahboomd/estop"):
                liar.declare_queryable(key, Callback(lie, indirect=False))
        honest = fleet.robots["bot1"]
        async with stopping(fleet, HERE) as (progress, _):
            before = honest.asked
            await eventually(lambda: honest.asked > before + 3 and progress.missing == [ONE])
        fleet.robots["bot1"].answer = STANDS


def lie(query: zenoh.Query) -> None:
    for key in (f"{ONE}/yahboomd/estop", str(query.key_expr)):
        try:
            query.reply(key, STANDS)
        except zenoh.ZError:
            continue
    query.drop()


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


async def test_tokens_that_go_as_the_connections_close_change_no_result(fleet: FleetBench) -> None:
    fleet.robots["bot1"].leave()  # so that no other token holds it
    papers, progress = fleet.file("people/vera"), FleetStop(HERE)
    whole = listed(fleet, HERE)
    stop = StopAll(whole, papers, progress, lambda _: None, SystemClock())
    way = StopWay("tcp/127.0.0.1:1", papers, [], stop)
    await stop.run()
    stop.seen(way, ONE, [TokenChange(key=ONE, present=False)])
    assert progress.all_stand


async def test_papers_that_are_none_end_it(fleet: FleetBench, tmp_path) -> None:
    papers = tmp_path / "broken.json5"
    papers.write_text("{")
    stop = StopAll(listed(fleet, HERE), papers, FleetStop(HERE), print, SystemClock())
    with pytest.raises(BusError, match="cannot be used"):
        await stop.run()


def test_the_command_prints_the_result_and_ends_by_it(
    fleet: FleetBench, capsys: pytest.CaptureFixture[str]
) -> None:
    late = RecordingRobot(fleet, "bot4")
    late.answer = STANDS
    assert main(["stop", "--all", "--fleet", str(fleet.file("people/vera"))]) == 0
    first, result = capsys.readouterr().out.splitlines()
    assert first == "Stopping 4 robots. Ctrl-C ends it."
    assert result.startswith("4 of 4 robots acknowledged, the last after ")
    assert result.endswith(" s; 4 stand.")
    late.sessions[0].close()


def test_an_interrupt_ends_the_command_with_the_list_of_who_is_missing(fleet: FleetBench) -> None:
    fleet.robots["bot2"].answer = ""
    process = Process("stop", "--all", "--fleet", str(fleet.file("people/vera")))
    try:
        process.says(f"2 of 4 robots acknowledged. Missing: {TWO}, {LATE}.")
        assert process.end(signal.SIGINT) == 1
    finally:
        process.end()
    assert "from now on nothing repeats the stop" in process.output
    assert f"{TWO}: did not answer, although its daemon is there." in process.output
    assert f"{LATE}: is not reachable." in process.output
