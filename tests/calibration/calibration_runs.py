"""Runs of robots whose true size differs: measured exactly, or by a tape on a floor that slips."""

from __future__ import annotations

import math

import numpy as np

from yahboomd.tools.calibrate.estimates.runs import Factors, Floats, Path, Run, path

TRUE = Factors(scale=1.04, ratio=0.985, track=0.92)
TRACK_M = 0.17
STEP_M = 0.01
SIDE_M = 2.0
STRAIGHT_M = 5.0
TAPE_M = 0.002
HEADING_RAD = math.sqrt(2.0) * TAPE_M / 0.3
"""By two marks 0.3 m apart."""


def straight(metres: float) -> tuple[Floats, Floats]:
    """The travel of both sides along a straight."""
    step = np.full(round(metres / STEP_M), STEP_M)
    return step, step


def turned(radians: float) -> tuple[Floats, Floats]:
    """The travel of both sides of a turn in place, by the nominal track."""
    rim = radians * TRACK_M / 2.0
    steps = max(1, round(abs(rim) / STEP_M))
    return np.full(steps, -rim / steps), np.full(steps, rim / steps)


def square(side: float, *, left: bool) -> tuple[Floats, Floats]:
    """The travel of both sides around a square."""
    corner = turned(math.pi / 2.0 if left else -math.pi / 2.0)
    legs = [straight(side), corner] * 4
    return np.concatenate([leg[0] for leg in legs]), np.concatenate([leg[1] for leg in legs])


def exact(kind: str, left: Floats, right: Floats, true: Factors = TRUE) -> Run:
    """A run that was measured without any error, on a floor without slip."""
    travelled = path(Run("pose", left, right, TRACK_M, (), ()), true)
    x, y, heading = (float(each[-1]) for each in travelled)
    measured = {"straight": (math.hypot(x, y),), "turn": (heading,), "pose": (x, y, heading)}[kind]
    return Run(kind, left, right, TRACK_M, measured, (0.002, 0.002, 0.01)[: len(measured)])


def squares_and_straight() -> list[Run]:
    runs = [exact("pose", *square(SIDE_M, left=left)) for left in (True, False)]
    return [*runs, exact("straight", *straight(STRAIGHT_M))]


class SlippingRobot:
    """A robot on a floor that slips: white noise on the travel of each wheel."""

    def __init__(self, rng: np.random.Generator, true: Factors, slip: float) -> None:
        self._rng = rng
        self._true = true
        self._slip = slip

    def _drive(self, left: Floats, right: Floats) -> Path:
        """The true path for counts that show ``left`` and ``right``."""

        def rolled(travel: Floats, factor: float) -> Floats:
            noise = self._rng.normal(size=len(travel)) * np.sqrt(np.abs(travel))
            return factor * travel + self._slip * noise

        rims = rolled(left, self._true.left), rolled(right, self._true.right)
        return path(Run("pose", *rims, TRACK_M, (), ()), Factors(track=self._true.track))

    def measured(self, left: Floats, right: Floats) -> Run:
        """A run with a tape's measurement of its end."""
        x, y, heading = (float(each[-1]) for each in self._drive(left, right))
        tape = self._rng.normal(size=3) * (TAPE_M, TAPE_M, HEADING_RAD)
        end = (x + tape[0], y + tape[1], heading + tape[2])
        return Run("pose", left, right, TRACK_M, end, (TAPE_M, TAPE_M, HEADING_RAD))
