"""Moves the robot along known shapes, within announced bounds, and gathers its counts."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from yahboomd.calibration.runs import Floats
from yahboomd.cli.robot.obedience import Obedience
from yahboomd.errors import NoDaemon, Refused
from yahboomd.messages.native import StatusSample, WheelsSample
from yahboomd.model import NS_PER_S

if TYPE_CHECKING:
    from yahboomd.cli.calibrate.asking import Answers
    from yahboomd.client import AsyncRobot, Samples
    from yahboomd.config import Config

SAMPLE_WITHIN_S = 3.0
"""Wheels are published many times a second; a daemon without any for so long does not run."""

REST_NS = NS_PER_S // 2
"""Counts that have not changed for so long do not change by rolling on."""

STANDS_WITHIN_NS = 20 * NS_PER_S


class Sides:
    """From the ticks of single motors to the travel of the two sides, with nominal radii.

    Args:
        config: The robot.
        names: The motors, in the order of the ticks.
    """

    def __init__(self, config: Config, names: Sequence[str]) -> None:
        from yahboomd.config.calibration_file import geometry_of

        geometry = geometry_of(config)
        per_tick = 2.0 * np.pi * geometry.wheel_radius_m / geometry.ticks_per_revolution
        wheels = config.kinematics().wheels
        side = {motor.name: wheels[motor.wheel] for motor in config.motors()}
        self._weights = np.zeros((2, len(names)))
        for row, which in enumerate(("left", "right")):
            mine = [i for i, name in enumerate(names) if side[name].endswith(which)]
            self._weights[row, mine] = per_tick / len(mine)
        self.separation_m = geometry.wheel_separation_m

    def travel(self, ticks: Sequence[Sequence[int]]) -> tuple[Floats, Floats]:
        """The travel of the left and the right side between the readings, metres."""
        steps = np.diff(np.array(ticks, dtype=float), axis=0) @ self._weights.T
        return steps[:, 0], steps[:, 1]


class Leg:
    """A part of a shape: a straight of some metres, or a turn in place of some radians."""

    def __init__(self, vx: float, wz: float, amount: float) -> None:
        self.vx = vx
        self.wz = wz
        self.amount = amount

    @property
    def limit_s(self) -> float:
        """So long it lasts at most, ramps and a weak battery included."""
        return 1.5 * self.amount / max(abs(self.vx), abs(self.wz)) + 5.0

    def done(self, left_m: float, right_m: float, separation_m: float) -> float:
        """The part of it that the robot has done, by the counts."""
        if self.vx:
            return (left_m + right_m) / 2.0 * (1.0 if self.vx > 0.0 else -1.0)
        return (right_m - left_m) / separation_m * (1.0 if self.wz > 0.0 else -1.0)


class Driver:
    """Drives legs and gathers counts.

    Args:
        robot: A connected client.
        sides: Of the robot.
        source: The key that it commands on.
    """

    def __init__(self, robot: AsyncRobot, config: Config, source: str) -> None:
        self._robot = robot
        self._config = config
        self._source = source
        self._samples: Samples[WheelsSample] = robot.samples(WheelsSample, depth=4096)
        self._ticks: list[tuple[int, ...]] = []
        self._stamp_ns = 0
        self.sides: Sides | None = None

    async def _next(self) -> Sides:
        try:
            async with asyncio.timeout(SAMPLE_WITHIN_S):
                sample = await anext(self._samples)
        except (TimeoutError, StopAsyncIteration):
            raise NoDaemon(
                "No counts come from the daemon: is the board connected?",
                remedy="`yahboomd status` says what it does.",
            ) from None
        if self.sides is None:
            self.sides = Sides(self._config, sample.names)
        self._ticks.append(sample.ticks)
        self._stamp_ns = sample.stamp_ns
        return self.sides

    async def begin(self) -> None:
        """Discard what was gathered; the robot stands."""
        await self._rest()
        del self._ticks[:-1]

    async def _rest(self) -> None:
        """Gather until the counts have not changed for a while.

        Raises:
            Refused: They change on: somebody moves the robot.
        """
        await self._next()
        begin_ns = changed_ns = self._stamp_ns
        while self._stamp_ns - changed_ns < REST_NS:
            before = self._ticks[-1]
            await self._next()
            if self._ticks[-1] != before:
                changed_ns = self._stamp_ns
            if self._stamp_ns - begin_ns > STANDS_WITHIN_NS:
                raise Refused("The wheels do not come to rest: nothing was written.")

    async def drive(self, leg: Leg) -> None:
        """Drive one leg, and wait until the robot stands.

        Raises:
            Refused: The robot does not obey, or does not get on.
            NoDaemon: It was lost.
        """
        before = await self._robot.get(StatusSample)
        if before is None:
            raise Refused("The daemon has published no status yet: nothing was driven.")
        obedience = Obedience(self._source, before)
        if trouble := obedience.trouble_before():
            raise Refused(f"Nothing was driven. {trouble}")
        first = self._ticks[-1]
        self._robot.drive(leg.vx, leg.wz, for_s=leg.limit_s)
        seen = before.stamp_ns
        try:
            while True:
                sides = await self._next()
                left, right = sides.travel([first, self._ticks[-1]])
                if leg.done(float(left[0]), float(right[0]), sides.separation_m) >= leg.amount:
                    break
                status = self._robot.newest(StatusSample)
                if status is not None and status.stamp_ns != seen:
                    seen = status.stamp_ns
                    if trouble := obedience.trouble(status):
                        raise Refused(f"The robot does not obey. {trouble}")
                if self._robot.commanded is None:
                    raise Refused(
                        f"After {leg.limit_s:.0f} s the robot was not where its counts should "
                        "be, and was stopped: do all wheels turn, and the right way round?"
                    )
        finally:
            self._robot.stop()
        await self._robot.finished()
        await self._rest()

    async def by_hand(self, answers: Answers, words: str) -> None:
        """Gather while the person moves the robot, until they press Enter."""
        waiting = asyncio.create_task(answers.line(words))
        try:
            while not waiting.done():
                await self._next()
            await waiting
        finally:
            waiting.cancel()
        await self._rest()

    def gathered(self) -> tuple[Floats, Floats, float]:
        """The travel of both sides since :meth:`begin`, in steps, and the nominal separation."""
        assert self.sides is not None
        return (*self.sides.travel(self._ticks), self.sides.separation_m)


def straight(metres: float, speed: float) -> list[Leg]:
    """One straight."""
    return [Leg(speed, 0.0, metres)]


def turns(radians: float, speed: float) -> list[Leg]:
    """Turns in place; negative is clockwise."""
    return [Leg(0.0, speed if radians > 0.0 else -speed, abs(radians))]


def square(side: float, speed: float, turn_speed: float, *, left: bool) -> list[Leg]:
    """A square that ends where it began, heading included."""
    around = turn_speed if left else -turn_speed
    return [leg for _ in range(4) for leg in (Leg(speed, 0.0, side), Leg(0.0, around, np.pi / 2))]
