"""A page leads the wizard: the robot moves while its button is held, and by nothing else."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import signal
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from bench_client import BenchClient
from real_robot import Process, RealRobot
from robot_bench import RobotBench
from web_site import Page, Site
from websockets.asyncio.client import connect
from zenoh_fixtures import PATIENCE_S, eventually

from yahboomd.cli.shell import command_tree
from yahboomd.core.config import Loaded
from yahboomd.simulation.truth import TruthSample
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.web.page_calibration import FORMS, PageCalibration

pytestmark = pytest.mark.xdist_group("web_tools")

QUICK = {"straight": 1, "turns": 1, "speed": 0.4, "turn-speed": 2}

STOPS_WITHIN_M = 0.6
"""Of the metre of a run, at 0.4 m/s: in that the daemon's own timeout ends it, were it the last."""

Start = Callable[..., Awaitable[Site]]


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RealRobot]:
    made = RealRobot(tmp_path_factory.mktemp("robot"))
    made.daemon.says("Connected to")
    yield made
    made.close()


@pytest.fixture
def state(tmp_path: Path) -> Path:
    """The calibration file."""
    return tmp_path / "calibration.toml"


class Thumb:
    """Holds the button of a page, 20 times a second; again if a busy machine let it lapse.

    Args:
        page: With the button.
        question: The question of the button, even if another was asked since; None: the latest.
        behind: The number of beats by which each hold is late.
    """

    def __init__(self, page: Page, question: dict[str, Any] | None = None, behind: int = 0) -> None:
        self._page, self._question, self._behind = page, question, behind
        self._task = asyncio.create_task(self._hold())

    async def _hold(self) -> None:
        with contextlib.suppress(Exception):
            while True:
                beat = self._page.beat - self._behind
                asked = self._question or self._page.of("calibration")[-1]["question"] or {}
                await self._page.send(type="hold", beat=beat, question=asked.get("id", ""))
                await asyncio.sleep(0.05)

    async def lift(self) -> None:
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)


async def use(page: Page, do: str, **args: Any) -> dict[str, Any]:
    """Use a tool; the answer."""
    number = len(page.of("answer")) + 1
    await page.send(type="tool", id=number, do=do, args=args)
    return await page.one("answer", id=number)


async def patiently(condition: Callable[[], Any]) -> Any:
    """As ``eventually``, for work that a busy machine may have to repeat."""
    async with asyncio.timeout(300.0):
        while not (found := condition()):
            await asyncio.sleep(0.02)
    return found


async def question(page: Page, kind: str = "", after: str = "") -> dict[str, Any]:
    """Wait for a question, of a kind or of any."""

    def found() -> dict[str, Any] | None:
        shown = page.of("calibration")[-1]
        asked: dict[str, Any] | None = shown["question"]
        assert shown["page"] is not None or not shown["refused"], shown
        if asked and kind in {"", asked["kind"]} and asked["id"] != after:
            return asked
        return None

    result: dict[str, Any] = await patiently(found)
    return result


def travelled(before: TruthSample, after: TruthSample) -> float:
    """The farthest that a wheel came between two moments, in metres."""
    return max(b - a for a, b in zip(before.travel_m, after.travel_m, strict=True))


async def moved_through(
    page: Page, robot: RealRobot, asked: dict[str, Any]
) -> tuple[TruthSample, dict[str, Any]]:
    """Hold until a run is over, again if it was interrupted; its begin, and the question."""
    while asked["kind"] == "hold":
        begin = await asyncio.to_thread(robot.settled_truth)
        thumb = Thumb(page, asked)
        asked = await question(page, after=asked["id"])
        await thumb.lift()
    return begin, asked


async def moving(robot: RealRobot) -> None:
    await patiently(lambda: max(map(abs, robot.truth()[-1].speed_m_s)) > 0.1)


async def started(site: Start, robot: RealRobot) -> tuple[Site, Page, dict[str, Any]]:
    served = await site(endpoint=robot.endpoint)
    await eventually(lambda: served.hub.robot.obstacle() is None)
    page = await served.page()
    answer = await use(page, "calibrate", verb="tape", choices=QUICK)
    assert answer["ok"], answer
    return served, page, await question(page, "hold")


@pytest.mark.nightly
@pytest.mark.realtime
async def test_the_robot_moves_while_the_button_is_held_and_not_after(
    site: Start, robot: RealRobot, state: Path
) -> None:
    served, page, asked = await started(site, robot)
    before = await asyncio.to_thread(robot.settled_truth)
    thumb = Thumb(page)
    await moving(robot)
    await page.refused("calibrating", vx=-0.2, vy=0.0, wz=0.0)
    held = page.of("calibration")[-1]["question"]["id"]
    lifted = robot.truth()[-1]
    await thumb.lift()
    await page.send(type="let_go")
    again = await question(page, "hold", after=held)
    assert again["text"].startswith("The button was let go")
    stopped = await asyncio.to_thread(robot.settled_truth)
    assert sum(stopped.travel_m) > sum(before.travel_m)
    assert travelled(lifted, stopped) < STOPS_WITHIN_M
    # The thumb of the movement that is over begins no other.
    thumb = Thumb(page, asked)
    await eventually(lambda: robot.truth()[-1].t_ns > stopped.t_ns + 1_000_000_000)
    await thumb.lift()
    assert (await asyncio.to_thread(robot.settled_truth)).travel_m == stopped.travel_m
    thumb = Thumb(page)
    asked = await question(page, "number")
    await thumb.lift()
    answer = await use(page, "answer", question=asked["id"], text="far")
    assert answer["ok"]
    assert (await question(page, "number", after=asked["id"]))["wrong"]
    assert (await use(page, "end_calibration"))["ok"]
    shown = await page.one("calibration", page=None, verb="tape")
    assert "nothing was written" in shown["refused"]
    assert not state.exists()
    # The thumb on the joystick, refused during the calibration, has to be lifted first.
    await page.refused("let_go", vx=0.2, vy=0.0, wz=0.0)
    # A page that leaves in mid-run stops it, and ends the wizard.
    await page.drive(0.0)
    assert (await use(page, "calibrate", verb="tape", choices=QUICK))["ok"]
    await question(page, "hold")
    Thumb(page)
    await moving(robot)
    before = robot.truth()[-1]
    await page.close()
    await eventually(lambda: served.hub.tools.calibration.page is None)
    assert travelled(before, await asyncio.to_thread(robot.settled_truth)) < STOPS_WITHIN_M
    assert not state.exists()


@pytest.mark.nightly
@pytest.mark.realtime
async def test_a_whole_calibration_is_written_where_the_robots_daemon_reads_it_and_taken_back(
    site: Start, robot: RealRobot, state: Path
) -> None:
    _, page, asked = await started(site, robot)
    for run in range(3):
        begin, number = await moved_through(page, robot, asked)
        end = await asyncio.to_thread(robot.settled_truth)
        metres = math.hypot(end.x - begin.x, end.y - begin.y)
        degrees = math.degrees(abs(end.theta - begin.theta)) - 360.0
        text = f"{degrees if run else metres:.4f}"
        assert (await use(page, "answer", question=number["id"], text=text))["ok"]
        if not run:
            beside = await question(page, "number", after=number["id"])
            assert beside["name"] == "left"
            left_m = (end.y - begin.y) * math.cos(begin.theta)
            left_m -= (end.x - begin.x) * math.sin(begin.theta)
            text = f"{1e3 * left_m:.1f}"
            assert (await use(page, "answer", question=beside["id"], text=text))["ok"]
        if run < 2:
            asked = await question(page, "hold", after=asked["id"])
    shown = await page.one("calibration", page=None, verb="tape")
    assert shown["refused"] == ""
    assert shown["result"]["written"] == str(state)
    assert state.exists()
    answer = await use(page, "undo_calibration")
    assert answer["ok"]
    assert "Taken back" in answer["text"]
    assert not state.exists()
    assert not (await use(page, "undo_calibration"))["ok"]


@pytest.mark.nightly
@pytest.mark.realtime
async def test_holds_with_an_old_beat_move_nothing_and_are_refused_with_the_reason(
    site: Start, robot: RealRobot
) -> None:
    _, page, asked = await started(site, robot)
    await eventually(lambda: len(page.of("beat")) > 30)
    before = await asyncio.to_thread(robot.settled_truth)
    thumb = Thumb(page, asked, behind=10)
    refusal = await page.one("refused", what="hold", why="late")
    assert refusal["age_ms"] > 300
    await eventually(lambda: robot.truth()[-1].t_ns > before.t_ns + 1_000_000_000)
    await thumb.lift()
    assert robot.truth()[-1].travel_m == before.travel_m


@pytest.mark.nightly
@pytest.mark.realtime
async def test_another_page_watches_and_when_it_takes_control_the_wizard_ends(
    site: Start, robot: RealRobot, state: Path
) -> None:
    served, page, asked = await started(site, robot)
    other = await served.page()
    assert (await other.one("calibration", page=1))["question"] == asked
    assert not (await use(other, "calibrate", verb="tape", choices={}))["ok"]
    assert not (await use(other, "answer", question=asked["id"], text="1"))["ok"]
    assert not (await use(other, "end_calibration"))["ok"]
    await other.refused("not_calibrating", "hold", question=asked["id"])
    Thumb(page)
    await moving(robot)
    await other.send(type="control", want=True)
    await other.one("calibration", page=None, verb="tape")
    await asyncio.to_thread(robot.settled_truth)
    assert not state.exists()


@pytest.mark.nightly
@pytest.mark.realtime
async def test_a_server_that_is_killed_in_mid_run_leaves_neither_motion_nor_a_file(
    robot: RealRobot, tmp_path: Path, state: Path
) -> None:
    server = Process(
        "web",
        "--listen=127.0.0.1:0",
        f"--connect={robot.endpoint}",
        f"--set=chassis.calibration_file={state}",
        environ={"HOME": str(tmp_path)},
    )
    await asyncio.to_thread(server.says, "The page is at")
    await asyncio.to_thread(server.says, "answers")
    origin = server.output.split("The page is at ")[1].split("/\n")[0].rstrip("/")
    address = origin.replace("http", "ws") + "/ws"
    page = Page(await connect(address, origin=origin, open_timeout=PATIENCE_S))
    try:
        await page.one("daemon", alive=True)
        answer = await use(page, "calibrate", verb="tape", choices=QUICK)
        assert answer["ok"], answer
        await question(page, "hold")
        thumb = Thumb(page)
        await moving(robot)
        server.end(signal.SIGKILL)
        before = robot.truth()[-1]
        stopped = await asyncio.to_thread(robot.settled_truth)
        assert travelled(before, stopped) < STOPS_WITHIN_M
        await thumb.lift()
    finally:
        server.end(signal.SIGKILL)
        await page.close()
    assert not state.exists()


@pytest.mark.nightly
def test_a_page_may_choose_whatever_the_command_lets_a_person_choose() -> None:
    found = {
        node.words[2]: {flag for option in node.options for flag in option.flags}
        for node in command_tree.whole().walk()
        if node.words[1:2] == ("calibrate",) and len(node.words) == 3
    }
    elsewhere = {"--json", "--source", "--dialogue", "--held", "--help", "-h"}
    of_the_robot = {"--timeout", "--connect", "--namespace", "--config", "--set", "-c"}
    for verb, fields in FORMS.items():
        ours = {f"--{name}" for name in fields}
        assert found[verb] - elsewhere - of_the_robot == ours


PAGE = 1


class Led:
    """A calibration led by a page, of a robot on virtual time."""

    def __init__(self, bench: RobotBench, client: BenchClient, state: Path) -> None:
        self.bench = bench
        self.file = state / "calibration.toml"
        loaded = Loaded(bench.config, None, calibration_path=self.file)  # type: ignore[arg-type]
        self.wizard = PageCalibration(
            bench.clock,
            lambda: client,  # type: ignore[arg-type, return-value]
            lambda: loaded,
            "cmd_vel",
            changed=lambda: None,
        )

    @property
    def shown(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self.wizard.shown())
        return found

    @property
    def question(self) -> dict[str, Any]:
        return self.shown["question"] or {"id": "", "kind": ""}

    def begin(self, **choices: Any) -> None:
        assert self.wizard.begin(PAGE, "tape", QUICK | choices) == ""

    async def asked(self, kind: str) -> dict[str, Any]:
        await self.bench.until(lambda: self.question["kind"] == kind or self.over)
        assert not self.over, self.shown
        return self.question

    @property
    def over(self) -> bool:
        return self.wizard.page is None

    async def hold(self, until: Callable[[], object]) -> None:
        """Hold the button of the open question, 20 times a second."""
        asked = self.question["id"]
        while not until() and not self.over:
            self.wizard.hold(PAGE, asked)
            await asyncio.sleep(0.05)

    def moves(self) -> bool:
        return max(map(abs, self.bench.rim_speeds)) > 0.1

    async def ended(self) -> None:
        """It ends, the wheels stand and stay, another source may drive, and nothing is written."""
        await self.bench.until(lambda: self.over, within_s=5.0)
        await self.bench.until(lambda: self.bench.standing, within_s=1.0)
        await asyncio.sleep(1.0)
        assert self.bench.standing
        assert self.bench.controller.decision.driver is None
        await self.bench.drive(1.0, 0.2, source="cmd_vel/teleop")
        assert self.moves()
        await self.bench.until(lambda: self.bench.standing)
        assert not self.file.exists()


@contextlib.asynccontextmanager
async def led(state: Path, client: type[BenchClient] = BenchClient) -> AsyncIterator[Led]:
    async with RobotBench(state) as bench:
        await bench.ready()
        yield Led(bench, client(bench), state)


async def _at_once(_: Led) -> None:
    pass


async def _loading(robot: Led) -> None:
    await asyncio.sleep(0)


async def _asked(robot: Led) -> None:
    await robot.asked("hold")


async def _moving(robot: Led) -> None:
    await robot.asked("hold")
    await robot.hold(robot.moves)


async def _coming_to_rest(robot: Led) -> None:
    await _moving(robot)
    robot.wizard.let_go(PAGE)


async def _measured(robot: Led) -> None:
    await robot.asked("hold")
    await robot.hold(lambda: robot.question["kind"] == "number")


MOMENTS = (_at_once, _loading, _asked, _moving, _coming_to_rest, _measured)
ENDS: dict[str, Callable[[Led], object]] = {
    "by its button": lambda robot: robot.wizard.end(PAGE),
    "by control": lambda robot: robot.wizard.control_changed(2),
    "twice": lambda robot: (robot.wizard.end(), robot.wizard.end()),
}


@pytest.mark.cases(2)
@pytest.mark.parametrize(
    ("moment", "way"),
    [*((each, "by control") for each in MOMENTS), (_moving, "by its button"), (_moving, "twice")],
)
@on_virtual_time
async def test_a_calibration_that_is_ended_at_any_moment_leaves_standing_wheels_and_control_free(
    tmp_path: Path, moment: Callable[[Led], Awaitable[None]], way: str
) -> None:
    async with led(tmp_path) as robot:
        robot.begin()
        await moment(robot)
        ENDS[way](robot)
        await robot.ended()
        assert "nothing was written" in robot.shown["refused"]
        assert robot.wizard.answer(PAGE, "move-1", "1") == "No calibration runs."


@on_virtual_time
async def test_a_page_that_falls_silent_in_mid_run_stops_the_robot_and_is_asked_again(
    tmp_path: Path,
) -> None:
    async with led(tmp_path) as robot:
        robot.begin()
        await _moving(robot)
        held = robot.question["id"]
        await robot.bench.until(lambda: robot.question["id"] != held, within_s=1.0)
        await robot.bench.until(lambda: robot.bench.standing, within_s=1.0)
        assert robot.question["text"].startswith("The button was let go")
        # Holds of the movement that is over.
        for _ in range(20):
            robot.wizard.hold(PAGE, held)
            await asyncio.sleep(0.05)
        assert robot.bench.standing
        robot.wizard.end()
        await robot.ended()


@on_virtual_time
async def test_an_emergency_stop_in_mid_run_ends_the_calibration(tmp_path: Path) -> None:
    async with led(tmp_path) as robot:
        robot.begin()
        await _moving(robot)
        robot.bench.operator.engage_estop("a page")
        await robot.hold(lambda: False)
        await robot.bench.until(lambda: robot.bench.standing, within_s=1.0)
        assert robot.shown["refused"]
        assert robot.bench.controller.state()[0] == "estopped"
        assert not robot.file.exists()


@on_virtual_time
async def test_a_server_that_ends_waits_until_the_wheels_stand(tmp_path: Path) -> None:
    async with led(tmp_path) as robot:
        robot.begin()
        await _moving(robot)
        await asyncio.wait_for(robot.wizard.close(), 3.0)
        assert robot.bench.standing
        await robot.ended()


class _FailingClient(BenchClient):
    """Fails in the middle of a run, as a mistake in the tool would."""

    fails = False

    def newest(self, message: Any) -> Any:
        if self.fails and self.commanded is not None:
            raise ZeroDivisionError("a mistake")
        return super().newest(message)


@pytest.mark.nightly
@on_virtual_time
async def test_a_mistake_in_a_calibration_stops_the_robot_and_ends_nothing_but_itself(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        client = _FailingClient(bench)
        robot = Led(bench, client, tmp_path)
        robot.begin()
        await _moving(robot)
        client.fails = True
        await robot.ended()
        assert "ZeroDivisionError: a mistake" in robot.shown["refused"]
        assert "a mistake" in caplog.text
        client.fails = False
        robot.begin()
        await robot.asked("hold")
        robot.wizard.end()
        await robot.wizard.close()


@pytest.mark.nightly
@on_virtual_time
async def test_while_the_result_is_calculated_the_server_serves_pages(tmp_path: Path) -> None:
    turns = 0

    async def turn() -> None:
        nonlocal turns
        while True:
            turns += 1
            await asyncio.sleep(0)

    async with led(tmp_path) as robot:
        robot.begin(**{"dry-run": True})
        for name in ("length", "left", "side", "beyond", "beyond"):
            await robot.bench.until(lambda: robot.question["id"])
            await robot.hold(lambda: robot.question["kind"] == "number")
            asked = robot.question
            assert asked["name"] == name
            turns = 0
            serving = asyncio.create_task(turn())
            robot.wizard.answer(PAGE, asked["id"], {"length": "1.0", "side": "1"}.get(name, "0"))
            while robot.question == asked and not robot.shown["result"]:
                await asyncio.sleep(0)
            serving.cancel()
        # Those of the calculation, in this test alone.
        assert turns > 20
        await robot.bench.until(lambda: robot.over)
        assert robot.shown["refused"] == ""
        assert robot.shown["said"] == ["A dry run: nothing was written."]
