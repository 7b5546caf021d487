"""Runs of a robot that is off, measured without any error."""

from __future__ import annotations

import math

from benchmarks.random_robots import SIDE_M, STRAIGHT_M, TRACK_M, square, straight
from yahboomd.tools.calibrate.estimates.runs import Factors, Run, path

TRUE = Factors(scale=1.04, ratio=0.985, track=0.92)


def exact(kind: str, left, right, true: Factors = TRUE) -> Run:
    """A run that was measured without any error, on a floor without slip."""
    travelled = path(Run("pose", left, right, TRACK_M, (), ()), true)
    x, y, heading = (float(each[-1]) for each in travelled)
    measured = {"straight": (math.hypot(x, y),), "turn": (heading,), "pose": (x, y, heading)}[kind]
    return Run(kind, left, right, TRACK_M, measured, (0.002, 0.002, 0.01)[: len(measured)])


def squares_and_straight() -> list[Run]:
    runs = [exact("pose", *square(SIDE_M, left=left)) for left in (True, False)]
    return [*runs, exact("straight", *straight(STRAIGHT_M))]
