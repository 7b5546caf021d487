"""The exactness of a calibration of random robots: the table of docs/calibration.md.

A differential base of 0.17 m track, its radius off by up to 5 %, its track by up to 10 %, its ratio
by up to 2 %. It drives squares of 2 m each way and a straight of 5 m by its own counts. Slip is
white noise on each wheel's travel. A person measures with a tape, the heading by two marks 0.3 m
apart. Then the calibrated robot drives a figure of eight of 40 m beside a robot that is known
perfectly, on the same slip.
"""

from __future__ import annotations

import argparse
import json
import math
from typing import NamedTuple

import numpy as np

from yahboomd.tools.calibrate.estimates.least_squares import SLIP_M_PER_SQRT_M, fit
from yahboomd.tools.calibrate.estimates.runs import Factors, Floats, Path, Run, path

TRACK_M = 0.17
STEP_M = 0.01
SIDE_M = 2.0
STRAIGHT_M = 5.0
TAPE_M = 0.002
HEADING_RAD = math.sqrt(2.0) * TAPE_M / 0.3
SQUARES = 5
EIGHT_M = 40.0
MEDIAN = 0.6745
"""Half of all errors are smaller than this part of their deviation."""


class Trial(NamedTuple):
    """The result of one robot: errors as fractions, and of the figure of eight in metres."""

    track: float
    scale: float
    ratio: float
    umbmark_track: float
    umbmark_ratio: float
    eight_m: float
    eight_known_m: float
    least_track: float
    least_scale: float
    least_ratio: float
    bound_ratio: float


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


def eight(metres: float) -> tuple[Floats, Floats]:
    """The travel of both sides around an eight of two circles."""
    steps = round(metres / STEP_M)
    turn = np.full(steps, 4.0 * math.pi / steps)
    turn[steps // 2 :] *= -1.0
    half = turn * TRACK_M / 2.0
    return STEP_M - half, STEP_M + half


class Robot:
    """A robot whose true size differs, on a floor that slips."""

    def __init__(self, rng: np.random.Generator, true: Factors, slip: float) -> None:
        self._rng = rng
        self.true = true
        self._slip = slip

    def drive(self, left: Floats, right: Floats) -> Path:
        """The true path for counts that show ``left`` and ``right``."""

        def rolled(travel: Floats, factor: float) -> Floats:
            noise = self._rng.normal(size=len(travel)) * np.sqrt(np.abs(travel))
            return factor * travel + self._slip * noise

        run = Run(
            "pose", rolled(left, self.true.left), rolled(right, self.true.right), TRACK_M, (), ()
        )
        return path(run, Factors(track=self.true.track))

    def measured(self, left: Floats, right: Floats) -> Run:
        """A run with a tape's measurement of its end."""
        x, y, heading = (float(each[-1]) for each in self.drive(left, right))
        tape = self._rng.normal(size=3) * (TAPE_M, TAPE_M, HEADING_RAD)
        end = (x + tape[0], y + tape[1], heading + tape[2])
        return Run("pose", left, right, TRACK_M, end, (TAPE_M, TAPE_M, HEADING_RAD))


def umbmark(runs: list[Run]) -> tuple[float, float]:
    """Track and ratio by the formulas of Borenstein and Feng (1996), from the same squares.

    The centres of the ends of each direction give the error of a corner and of a side.
    """
    ends = {}
    for left in (True, False):
        mine = [run for run in runs if run.kind == "pose" and (run.turned_rad > 0.0) is left]
        ends[left] = np.mean([np.array(run.measured[:2]) for run in mine], axis=0)
    (x_left, y_left), (x_right, y_right) = ends[True], ends[False]
    # Corner too small by alpha (rad), side bent to the left by beta (rad), both directions joined.
    alpha = (x_right + x_left + y_right - y_left) / (-8.0 * SIDE_M)
    beta = (x_right - x_left + y_right + y_left) / (-8.0 * SIDE_M)
    track = (math.pi / 2.0) / (math.pi / 2.0 - alpha)
    radius = SIDE_M / 2.0 / math.sin(beta / 2.0) if beta else math.inf
    ratio = 1.0 if math.isinf(radius) else (radius + TRACK_M / 2) / (radius - TRACK_M / 2)
    return track, ratio


def trial(rng: np.random.Generator, slip: float) -> Trial:
    """One random robot, calibrated, then driven around the eight."""
    true = Factors(
        scale=1.0 + rng.uniform(-0.05, 0.05),
        ratio=1.0 + rng.uniform(-0.02, 0.02),
        track=1.0 + rng.uniform(-0.10, 0.10),
    )
    robot = Robot(rng, true, slip)
    runs = [
        robot.measured(*square(SIDE_M, left=left)) for left in (True, False) for _ in range(SQUARES)
    ]
    runs.append(robot.measured(*straight(STRAIGHT_M)))
    result = fit(runs, slip=slip)
    found, std = result.factors, result.std
    by_umbmark_track, by_umbmark_ratio = umbmark(runs[:-1])
    course = eight(EIGHT_M)
    actual = robot.drive(*course)

    def off(factors: Factors) -> float:
        believed = path(Run("pose", *course, TRACK_M, (), ()), factors)
        return float(np.hypot(believed.x - actual.x, believed.y - actual.y).max())

    driven = sum(float(np.abs(run.left).sum()) for run in runs)
    return Trial(
        abs(found.track / true.track - 1.0),
        abs(found.scale / true.scale - 1.0),
        abs(found.ratio / true.ratio - 1.0),
        # The formulas give the track relative to the wheels' size.
        abs(by_umbmark_track / (true.track / true.scale) - 1.0),
        abs(by_umbmark_ratio / true.ratio - 1.0),
        off(found),
        off(true),
        # The median error of a fit that wastes nothing of these measurements.
        *(MEDIAN * each for each in (std.track, std.scale, std.ratio)),
        # If every step of the true path were known, slip alone would limit the ratio.
        slip * math.sqrt(2.0 / driven),
    )


def summary(trials: int, slip: float, seed: int) -> dict[str, float]:
    """Medians and 95th percentiles over random robots; errors in percent."""
    rng = np.random.default_rng(seed)
    table = np.array([trial(rng, slip) for _ in range(trials)])
    found: dict[str, float] = {"slip_per_0.1_m": slip * math.sqrt(10.0), "robots": trials}
    for name, column in zip(Trial._fields, table.T, strict=True):
        unit = 1.0 if name.endswith("_m") else 100.0
        found[f"{name}_median"] = float(np.median(column)) * unit
        found[f"{name}_p95"] = float(np.percentile(column, 95)) * unit
    found["eight_against_known"] = found["eight_m_median"] / found["eight_known_m_median"]
    return found


def main() -> None:
    """Print a table for each amount of slip."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    for share in (1.0, math.sqrt(0.1), 0.1):
        print(json.dumps(summary(args.robots, share * SLIP_M_PER_SQRT_M, args.seed), indent=1))


if __name__ == "__main__":
    main()
