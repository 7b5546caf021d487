"""The questions of ``calibrate tape`` and ``squares``, and the runs between them."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

from yahboomd.core.errors import Refused
from yahboomd.tools.calibrate.choices import TapeRuns
from yahboomd.tools.calibrate.shapes import (
    Interrupted,
    Leg,
    LegDriver,
    sideways,
    square,
    straight,
    turns,
)
from yahboomd.tools.terminal.asking import Number

if TYPE_CHECKING:
    from yahboomd.tools.calibrate.choices import SquareRuns
    from yahboomd.tools.calibrate.estimates.runs import Run
    from yahboomd.tools.calibrate.estimates.sideways import SidewaysRun
    from yahboomd.tools.terminal.asking import Person

TAPE_STD_M = 0.002
"""The accuracy with which a person reads a tape beside a robot."""

ANGLE_STD_RAD = math.radians(0.5)
"""The accuracy with which a person sees an angle against a mark."""

BEYOND = Number(
    *("beyond", "How many degrees beyond its mark did it turn? (negative: short of it)", "deg"),
    good=lambda value: abs(value) < 3600.0,
    wrong="A number of degrees, such as 12.5 or -8.",
    blank=0.0,
)


def side(did: str) -> Number:
    """The question for the side to which it did something."""
    return Number(
        "side",
        f"To which side did it {did}, seen from above? 1: to the left, 2: to the right "
        "(empty: left)",
        unit="1 or 2",
        good=lambda value: value in {1.0, 2.0},
        wrong="1 for the left, or 2 for the right.",
        blank=1.0,
    )


HEADING = Number(
    *("heading", "How many degrees to the left does it point? (empty: not measured)", "deg"),
    good=lambda value: abs(value) <= 360.0,
    wrong="A number of degrees, or nothing.",
)


LENGTH_RANGE = (0.25, 4.0)
"""The true way, as a multiple of the counted one: no wrong profile of the vendor's exceeds it."""


def length(counted_m: float) -> Number:
    """The question for the true way.

    Args:
        counted_m: The way by the counts, which shows answers in another unit.
    """
    least, most = (counted_m * each for each in LENGTH_RANGE)
    return Number(
        *("length", "How far did it truly go, in m?", "m"),
        good=lambda value: least < value < most,
        wrong=f"A number of metres near {counted_m:.3f}, which the wheels counted; an empty answer "
        "ends it here.",
    )


class MeasuredRuns:
    """The runs of a calibration: each is announced, driven and measured."""

    def __init__(self, driver: LegDriver, person: Person, choices: TapeRuns | SquareRuns) -> None:
        self._driver = driver
        self._person = person
        self._choices = choices

    async def by_tape(self, options: TapeRuns, *, bend: bool) -> list[Run]:
        runs = [await self._straight(bend=bend, heading=False)]
        for left in (True, False):
            way = "left" if left else "right"
            whole = 2.0 * math.pi * options.turns * (1.0 if left else -1.0)
            await self._move(
                f"turn {way}",
                turns(whole, options.turn_speed_rad_s),
                f"Turn {options.turns:g} times to the {way}: mark the direction of the robot.",
            )
            if left:
                await self._check_side(whole)
            beyond = await self._person.number(BEYOND)
            assert beyond is not None
            measured = whole + math.copysign(1.0, whole) * math.radians(beyond)
            runs.append(self._run("turn", (measured,), (ANGLE_STD_RAD,)))
        return runs

    async def _check_side(self, whole: float) -> None:
        """Ask which way it turned, unless the gyro saw it turn to the left.

        Raises:
            Refused: To the other side: left and right motors are exchanged.
        """
        if self._driver.gyro_rad > 0.5 * whole:
            return
        if await self._person.number(side("turn")) == 2.0:
            raise Refused(
                "It turned to the right where a turn to the left was commanded: the plugs of the "
                "left and the right motors are exchanged. Nothing was written. Compare the plugs "
                "with [chassis] in the configuration, or run `yahboomd setup` again."
            )

    async def sideways(self, side_m: float) -> list[SidewaysRun]:
        """Runs of a mecanum base to either side."""
        from yahboomd.tools.calibrate.estimates.sideways import SidewaysRun

        runs = []
        for left in (True, False):
            way = "left" if left else "right"
            await self._move(
                f"sideways {way}",
                sideways(side_m if left else -side_m, self._choices.speed_m_s),
                f"{side_m:g} m to the {way}, sideways: mark the robot's place.",
            )
            if left and await self._person.number(side("go")) == 2.0:
                raise Refused(
                    "It went to the right where the left was commanded: its wheels are mounted "
                    "mirrored. Nothing was written. Exchange the left and the right wheel of each "
                    "axle: seen from above the rollers must form an X."
                )
            steps = self._driver.gathered_sideways()
            measured = await self._length(float(abs(steps[1].sum())))
            runs.append(SidewaysRun(*steps, measured, TAPE_STD_M))
        return runs

    async def by_squares(self, options: SquareRuns) -> list[Run]:
        runs = []
        for left in (True, False):
            way = "left" if left else "right"
            for count in range(1, options.count + 1):
                await self._move(
                    f"square {way}",
                    square(options.side_m, options.speed_m_s, options.turn_speed_rad_s, left=left),
                    f"Square {count} of {options.count:g} to the {way}: put the robot on its mark.",
                )
                x = await self._metres("ahead", "How far ahead of its mark did it end, in mm?")
                y = await self._metres("left", "How far to the left of its mark, in mm?")
                runs.append(await self._end(x, y))
        runs.append(await self._straight(bend=True, heading=True))
        return runs

    async def _end(
        self, x: float, y: float, *, heading: bool = True, beside_std_m: float = TAPE_STD_M
    ) -> Run:
        """A run with this end, as seen from its start, in metres; may ask for the heading."""
        degrees = await self._person.number(HEADING) if heading else None
        measured: tuple[float, ...] = (x, y)
        std: tuple[float, ...] = (TAPE_STD_M, beside_std_m)
        if degrees is not None:
            measured, std = (*measured, math.radians(degrees)), (*std, ANGLE_STD_RAD)
        return self._run("pose", measured, std)

    async def _straight(self, *, bend: bool, heading: bool) -> Run:
        """Drive a straight.

        Args:
            bend: Ask how far it bent, which shows the ratio of the wheels.
            heading: Ask for its heading at the end; without it, the accuracy of the line is that of
                the start's heading, as a person sees an angle.
        """
        metres = self._choices.straight_m
        await self._move(
            "straight",
            straight(metres, self._choices.speed_m_s, ramps=not heading),
            f"A straight of {metres:g} m: mark the robot's place.",
        )
        left_m, right_m, _ = self._driver.gathered()
        far = await self._length(float(abs((left_m + right_m).sum()) / 2.0))
        if bend:
            left_mm = await self._person.number(
                Number(
                    "left",
                    "How far to the left of its line did it end, in mm? (negative: to the right; "
                    "empty: not measured)",
                    unit="mm",
                    good=lambda value: abs(value) < 1000.0 * far,
                    wrong=f"A number of millimetres below {1000.0 * far:.0f}, or nothing.",
                )
            )
            if left_mm is not None:
                left = left_mm / 1000.0
                ahead = math.sqrt(far * far - left * left)
                beside = TAPE_STD_M if heading else math.hypot(TAPE_STD_M, ANGLE_STD_RAD * far)
                return await self._end(ahead, left, heading=heading, beside_std_m=beside)
        return self._run("straight", (far,), (TAPE_STD_M,))

    async def _length(self, counted_m: float) -> float:
        found = await self._person.number(length(counted_m))
        if found is None:
            raise Refused("Without a length there is nothing to calibrate by: nothing was written.")
        return found

    async def _metres(self, name: str, question: str) -> float:
        value = await self._person.number(
            Number(
                name,
                f"{question} (negative: the other way)",
                unit="mm",
                good=lambda each: abs(each) < 100_000.0,
                wrong="A number of millimetres, such as 35 or -12.",
                blank=0.0,
            )
        )
        assert value is not None
        return value / 1000.0

    async def _move(self, run: str, legs: list[Leg], words: str) -> None:
        """Announce a shape, wait for the person, and drive it."""
        person, driver = self._person, self._driver
        person.about(run)
        while True:
            await driver.begin(person.start("move", words, driver.bounds(legs)))
            try:
                for part, leg in enumerate(legs, start=1):
                    await driver.drive(leg, partial(person.progress, part, len(legs)))
            except Interrupted as why:
                words = (
                    f"{why} This run does not count: put the robot back on its mark to repeat it."
                )
            else:
                return

    def _run(self, kind: str, measured: tuple[float, ...], std: tuple[float, ...]) -> Run:
        from yahboomd.tools.calibrate.estimates.runs import Run

        left, right, separation_m = self._driver.gathered()
        return Run(kind, left, right, separation_m, measured, std)  # type: ignore[arg-type]
