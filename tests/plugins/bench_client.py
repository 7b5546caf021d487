"""A client of a robot's bench, and a person with a tape beside it, for whole calibrations."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any, Self

from robot_bench import RobotBench, state_and_why

from yahboomd.client.commanding import Repeater
from yahboomd.client.services import Answer
from yahboomd.core.bus import keys
from yahboomd.core.clock import nanoseconds
from yahboomd.core.config import Loaded
from yahboomd.core.messages.codecs import encode
from yahboomd.core.messages.native import (
    EventSample,
    StatusSample,
    VelocityCommand,
    WheelsSample,
    event_sample,
    wheels_sample,
)
from yahboomd.core.model import Pose2d, Twist2d
from yahboomd.tools.calibrate.calibration import calibrate
from yahboomd.tools.calibrate.choices import SquareRuns, TapeRuns
from yahboomd.tools.terminal.asking import LargestMove, Number

PERIOD_S = 0.02
"""Of the samples of the wheels, as a daemon publishes them."""

REPEATS_S = 0.05
STATUS_S = 0.5


class BenchClient:
    """What a calibration uses of ``AsyncRobot``, without a bus between it and the daemon."""

    def __init__(self, bench: RobotBench) -> None:
        self._bench = bench
        self._repeater = Repeater()
        self._status: StatusSample | None = None
        self._callbacks: list[Callable[[EventSample], object]] = []
        self._seen_events = 0
        self._task: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        self._task = asyncio.create_task(self._run())
        return self

    async def __aexit__(self, *_: object) -> None:
        assert self._task is not None
        if self.commanded is not None:
            self.stop()
            await self.finished()
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)

    async def _run(self) -> None:
        while True:
            self._put()
            events = self._bench.heard.events
            for event in events[self._seen_events :]:
                for callback in self._callbacks:
                    callback(event_sample(event, stamp_ns=self._bench.clock.wall_ns()))
            self._seen_events = len(events)
            await asyncio.sleep(REPEATS_S)

    def _put(self) -> None:
        twist = self._repeater.command(self._bench.clock.now_ns())
        if twist is not None:
            wish = VelocityCommand(vx=twist.vx, vy=twist.vy, wz=twist.wz)
            self._bench.payload(encode(wish, "json"))

    # Of ``AsyncRobot``.

    def drive(
        self, vx: float = 0.0, wz: float = 0.0, *, vy: float = 0.0, for_s: float = 1.0
    ) -> bool:
        until_ns = self._bench.clock.now_ns() + nanoseconds(for_s)
        self._repeater.drive(Twist2d(vx=vx, vy=vy, wz=wz), until_ns)
        self._put()
        return True

    def stop(self) -> None:
        self._repeater.stop(self._bench.clock.now_ns())
        self._put()

    @property
    def commanded(self) -> Twist2d | None:
        return self._repeater.command(self._bench.clock.now_ns())

    async def finished(self) -> bool:
        while self.commanded is not None:
            await asyncio.sleep(REPEATS_S)
        return self._repeater.ended in {"time", "stop"}

    async def standing(self) -> bool:
        async with asyncio.timeout(2.0):
            while not self._bench.standing:
                await asyncio.sleep(PERIOD_S)
        return True

    async def samples(self, message: type[WheelsSample], *, depth: int) -> AsyncIterator[Any]:
        del message, depth
        heard, names = self._bench.heard, tuple(m.name for m in self._bench.config.motors())
        seq = 0
        while True:
            await asyncio.sleep(PERIOD_S)
            if len(heard.estimates) == seq:
                continue
            seq = len(heard.estimates)
            yield wheels_sample(
                heard.estimates[-1],
                stamp_ns=heard.estimates[-1].stamp_ns,
                seq=seq,
                names=names,
                command_m_s=heard.commands[-1],
            )

    def on(self, message: type[Any], callback: Callable[[Any], object]) -> None:
        if message is EventSample:
            self._callbacks.append(callback)

    def newest(self, message: type[StatusSample]) -> StatusSample:
        del message
        bench, now_ns = self._bench, self._bench.clock.wall_ns()
        if self._status is None or now_ns - self._status.stamp_ns >= nanoseconds(STATUS_S):
            state, why = state_and_why(bench.controller)
            self._status = StatusSample(
                stamp_ns=now_ns,
                state=state,
                driver=bench.controller.decision.driver,
                since_ns=now_ns,
                why=why,
                board={},
                link={},
                command={**bench.intake.status_values(), **bench.controller.status_values()},
                bus={},
            )
        return self._status

    async def get(self, message: type[StatusSample], *, timeout_s: float) -> StatusSample:
        del timeout_s
        return self.newest(message)

    async def call(self, key: str, *, timeout_s: float) -> Answer:
        assert key == keys.CONFIG
        del timeout_s
        data = self._bench.config.resolved().as_data()
        return Answer(success=True, message="", answered=1, data=data)


class TapeAndMarks:
    """A person who measures what the robot truly did, without an error of their own.

    Args:
        turns: Whole turns that the robot is to make.

    Attributes:
        asked: The names of the questions.
        runs: The runs that these are about.
        said: What they were shown.
        facts: The result.
    """

    enter = "Enter"

    def __init__(self, truth: Callable[[], Pose2d], turns: int) -> None:
        self.asked: list[str] = []
        self.runs: list[str] = []
        self.said: list[str] = []
        self.facts: dict[str, Any] = {}
        self._truth = truth
        self._turns = turns
        self._begin = Pose2d(x=0.0, y=0.0, theta=0.0)

    def about(self, run: str) -> None:
        self.runs.append(run)

    async def confirm(self, name: str, words: str) -> None:
        raise AssertionError(f"{name}: {words}")

    async def start(self, name: str, words: str, bounds: LargestMove) -> None:
        del words, bounds
        self.asked.append(name)
        self._begin = self._truth()

    async def number(self, question: Number) -> float:
        self.asked.append(question.name)
        begin, end = self._begin, self._truth()
        dx, dy, turned = end.x - begin.x, end.y - begin.y, end.theta - begin.theta
        cos, sin = math.cos(begin.theta), math.sin(begin.theta)
        across = cos * dy - sin * dx
        return {
            "length": math.hypot(dx, dy),
            "ahead": 1e3 * (cos * dx + sin * dy),
            "left": 1e3 * across,
            "heading": math.degrees(math.remainder(turned, 2.0 * math.pi)),
            "side": 2.0 - ((across if self.runs[-1].startswith("sideways") else turned) > 0.0),
            "beyond": math.degrees(abs(turned)) - 360.0 * self._turns,
        }[question.name]

    def say(self, words: str) -> None:
        self.said.append(words)

    def progress(self, part: int, parts: int, done: float) -> None:
        assert 1 <= part <= parts
        assert done >= 0.0

    def result(self, table: str, facts: dict[str, Any]) -> None:
        del table
        self.facts = facts


async def calibrated(
    bench: RobotBench, choices: TapeRuns | SquareRuns, state: Path
) -> TapeAndMarks:
    """A whole calibration of the bench's robot, to its end."""

    def truth() -> Pose2d:
        bench.robot.truth(bench.clock.now_ns())
        return bench.robot.plant.chassis.pose

    turns = choices.turns if isinstance(choices, TapeRuns) else 0
    person = TapeAndMarks(truth, turns)
    async with BenchClient(bench) as client:
        await calibrate(
            client,  # type: ignore[arg-type]
            Loaded(bench.config, None, calibration_path=state / "calibration.toml"),  # type: ignore[arg-type]
            choices,
            person,
            clock=bench.clock,
        )
    return person
