"""Errors of position and heading by formula, rate and path, and the consistency of the covariance.

Three kinds of input are integrated. Exact travel of the wheels on mathematical paths shows a
formula's own error. Whole counts of an encoder (1320 a turn, wheel of 67 mm, track 0.17 m) on the
same paths and on 1000 random ones show the error of a real robot with perfect wheels. Counts
recorded from the simulated robot, with its motors and its serial line, are compared with the
simulator's ground truth at the end of each drive. The encoders' floor is the error of counts read
1000 times a second: a formula gets below it only by chance. All formulas integrate the same counts.
Errors of heading are left out for exact travel, where only single precision errs.
"""

from __future__ import annotations

import math
from pathlib import Path as File
from typing import TYPE_CHECKING

import numpy as np

from benchmarks import pictures
from benchmarks.formulas import FORMULAS, KINEMATICS, OURS, Counted, motors
from benchmarks.paths import (
    FINE_HZ,
    PATHS,
    RADIUS_M,
    TICK_M,
    TICKS,
    TRACK_M,
    Path,
    Truth,
    counts,
    random_path,
    truth,
)
from benchmarks.recorded import DRIVES, record
from benchmarks.results import Section, method, number
from yahboomd.core.odometry.covariance import NOISE_M, Covariance
from yahboomd.core.odometry.integrator import Integrator

if TYPE_CHECKING:
    from collections.abc import Sequence

RATES_HZ = (10, 20, 50, 100)
SLOPE_RATES_HZ = (5, 10, 20, 25, 40, 50, 100)
FINE_TICKS = 1e13
OFFSETS = (0.7, 0.23)
"""The position of each wheel within a tick at the start."""


def counted(path: Truth, rate_hz: int, ticks: float) -> tuple[Counted, Counted]:
    """The counters at a rate."""
    at = path.at(rate_hz)
    a, b = OFFSETS if ticks == TICKS else (0.5, 0.5)
    return counts(at.left, ticks, a), counts(at.right, ticks, b)


def errors(path: Truth, rate_hz: int, ticks: float, formula: str) -> tuple[float, float]:
    """Largest errors of position in mm and of heading in degrees."""
    at = path.at(rate_hz)
    x, y, theta = FORMULAS[formula](*counted(path, rate_hz, ticks), ticks)
    place = np.hypot(x - at.x, y - at.y).max()
    return 1000.0 * float(place), math.degrees(float(np.abs(theta - at.theta).max()))


def floor(path: Truth) -> tuple[float, float]:
    """The errors that the encoders alone cause: of position in mm, of heading in degrees."""
    return errors(path, FINE_HZ, TICKS, OURS)


def cell(values: Sequence[float]) -> str:
    """Figures at all rates."""
    return " / ".join("0" if value < 5e-6 else number(value) for value in values)


def tables_of_paths(section: Section, rates: tuple[int, ...]) -> None:
    """Integrate the named paths, exact and counted."""
    truths = {name: truth(path) for name, path in PATHS.items()}
    at = f"at {' / '.join(map(str, rates))} Hz"
    section.table(
        f"Largest error of position in mm {at}, exact wheel travel.",
        ["path", *FORMULAS],
        [
            [name, *(cell([errors(path, hz, FINE_TICKS, f)[0] for hz in rates]) for f in FORMULAS)]
            for name, path in truths.items()
        ],
    )
    places, headings = [], []
    shares: list[tuple[float, int, str]] = []
    turned: dict[str, float] = dict.fromkeys(FORMULAS, 0.0)
    for name, path in truths.items():
        floor_mm, floor_degrees = floor(path)
        far: list[str] = []
        off: list[str] = []
        for formula in FORMULAS:
            mm, degrees = zip(*(errors(path, hz, TICKS, formula) for hz in rates), strict=True)
            far.append(cell(mm))
            off.append(cell(degrees))
            turned[formula] = max(turned[formula], *degrees)
            if formula == OURS:
                share = [each / floor_mm for each in mm]
        shares += [(each, hz, name) for each, hz in zip(share, rates, strict=True)]
        places.append([name, *far, number(floor_mm), cell(share)])
        headings.append([name, *off, number(floor_degrees)])
    section.table(
        f"Largest error of position in mm {at}, whole counts.",
        ["path", *FORMULAS, "encoders' floor", f"{OURS} / floor"],
        places,
    )
    section.table(
        f"Largest error of heading in degrees {at}, whole counts.",
        ["path", *FORMULAS, "encoders' floor"],
        headings,
    )
    least, (most, hz, where) = min(shares)[0], max(shares)
    section.findings.append(
        f"On four named paths in whole counts, the error of position is {number(least)} to "
        f"{number(most)} times that of the encoders alone (most at {hz} Hz on {where}). The error "
        f"of heading is at most {number(turned.pop(OURS))}°; {number(max(turned.values()))}° with "
        "the other formulas."
    )


def table_of_random(section: Section, many: int, rates: tuple[int, ...]) -> dict[str, list[float]]:
    """Integrate random paths; returns the errors at 20 Hz by formula, for the picture."""
    place: dict[tuple[str, int], list[float]] = {}
    turn: dict[tuple[str, int], list[float]] = {}
    own: list[float] = []
    floors: list[float] = []
    for seed in range(many):
        path = truth(random_path(seed))
        floors.append(floor(path)[0])
        own.append(errors(path, 50, FINE_TICKS, OURS)[0] / floors[-1])
        for rate in rates:
            for formula in FORMULAS:
                mm, degrees = errors(path, rate, TICKS, formula)
                place.setdefault((formula, rate), []).append(mm)
                turn.setdefault((formula, rate), []).append(degrees)
    rows = []
    for formula in FORMULAS:
        for rate in rates:
            far, turned = place[formula, rate], turn[formula, rate]
            share = float(np.median(np.array(far) / np.array(floors)))
            rows.append(
                [formula, str(rate), number(float(np.median(far))),
                 number(float(np.quantile(far, 0.99))), number(max(far)), number(share),
                 number(max(turned))]
            )  # fmt: skip
    section.table(
        f"{many} random paths of 20 s, whole counts: largest error along each. The encoders' floor "
        f"is {number(float(np.median(floors)))} mm at the median.",
        ["formula", "Hz", "median mm", "p99 mm", "worst mm", "median / floor", "worst heading °"],
        rows,
    )
    bound = math.degrees(2.0 * TICK_M / TRACK_M)
    worst = max(max(turn[OURS, rate]) for rate in rates)
    verdict = "reached" if worst <= bound else "missed"
    section.findings.append(
        f"On {many} random paths the heading is never off by more than {number(worst)}°. Goal: two "
        f"encoder ticks over the track, {number(bound)}°: {verdict}."
    )
    section.findings.append(
        "On those paths, at 50 Hz, the formula itself errs by "
        f"{number(100 * float(np.median(own)))} % of what the encoders alone err at the median, "
        f"{number(100 * max(own))} % at worst."
    )
    return {formula: place[formula, 20] for formula in FORMULAS}


def tables_of_records(section: Section, rates: tuple[int, ...]) -> None:
    """Integrate drives of the simulated robot."""
    places, headings = [], []
    for name, drive in DRIVES.items():
        far: dict[str, list[float]] = {formula: [] for formula in FORMULAS}
        turned: dict[str, list[float]] = {formula: [] for formula in FORMULAS}
        for rate in rates:
            taken = record(drive, dialect="polled", poll_rate_hz=rate)
            left = np.array([reading.ticks[0] for reading in taken.readings])
            right = np.array([reading.ticks[2] for reading in taken.readings])
            for formula, integrate in FORMULAS.items():
                x, y, theta = integrate(left, right, TICKS)
                far[formula].append(1000 * math.hypot(x[-1] - taken.end.x, y[-1] - taken.end.y))
                off = abs(math.degrees(float(theta[-1]) - taken.end.theta))
                turned[formula].append(off)
        named = f"{name}, {number(taken.length_m)} m"
        places.append([named, *map(cell, far.values())])
        headings.append([named, *map(cell, turned.values())])
    at = f"at the end at {' / '.join(map(str, rates))} Hz."
    recorded = "Counts recorded from the simulated robot, polled: error of"
    section.table(f"{recorded} position in mm {at}", ["drive", *FORMULAS], places)
    section.table(f"{recorded} heading in degrees {at}", ["drive", *FORMULAS], headings)


def slopes(section: Section) -> dict[str, list[float]]:
    """The order of convergence: how the error falls with the rate, on exact travel."""
    path = truth(PATHS["figure of eight, 40 m"])
    found = {
        formula: [errors(path, rate, FINE_TICKS, formula)[0] for rate in SLOPE_RATES_HZ]
        for formula in FORMULAS
    }
    rows = []
    for formula, values in found.items():
        # At higher rates rounding of the single-precision formula would spoil the fit.
        few = slice(0, 4)
        fit = np.polyfit(np.log(SLOPE_RATES_HZ[few]), np.log(values[few]), 1)
        rows.append([formula, number(-float(fit[0])), number(values[1])])
    section.table(
        "Order of convergence on the figure of eight (exact travel, 5 to 25 Hz), and the error at "
        "10 Hz in mm.",
        ["formula", "order", "mm"],
        rows,
    )
    others = [values[1] for formula, values in found.items() if formula != OURS]
    section.findings.insert(
        0,
        f"With ideal wheels on a figure of eight of 40 m, read at 10 Hz, yahboomd's formula is off "
        f"by {number(found[OURS][1])} mm at most, the others by {number(min(others))} to "
        f"{number(max(others))} mm.",
    )
    return found


def nees(runs: int, path: Path, seed: int) -> float:
    """Average of (error² over covariance) / 3 at the end of runs with noisy wheels; 1 is ideal.

    Each wheel's travel errs by a random walk of NOISE_M per metre, as the covariance assumes.
    """
    chance = np.random.default_rng(seed)
    rate = 50
    fine = truth(path)
    at = fine.at(rate)
    total = 0.0
    for _ in range(runs):
        columns = []
        for travel in (at.left, at.right):
            steps = np.abs(np.diff(travel))
            walk = np.cumsum(chance.normal(0.0, np.sqrt(NOISE_M * steps)))
            noisy = travel + np.concatenate(([0.0], walk))
            columns.append(counts(noisy, TICKS, chance.uniform()).tolist())
        integrator = Integrator(KINEMATICS, motors(TICKS))
        covariance = Covariance(KINEMATICS, motors(TICKS))
        start = columns[0][0], columns[1][0]
        before = (0, 0)
        for left, right in zip(columns[0][1:], columns[1][1:], strict=True):
            now = left - start[0], right - start[1]
            deltas = now[0] - before[0], now[1] - before[1]
            covariance.propagate(deltas, integrator.integrate(deltas, now, 1))
            before = now
        pose = integrator.pose
        error = np.array([pose.x - at.x[-1], pose.y - at.y[-1], pose.theta - at.theta[-1]])
        total += float(error @ np.linalg.solve(np.array(covariance.pose).reshape(3, 3), error))
    return total / runs / 3.0


def table_of_nees(section: Section, runs: int) -> None:
    """Compare the covariance with the errors."""
    # Wilson and Hilferty's bounds of chi-squared over its degrees, 99 %.
    degrees = 3 * runs
    spread = 2.5758 * math.sqrt(2.0 / (9.0 * degrees))
    low, high = ((1.0 - 2.0 / (9.0 * degrees) + sign * spread) ** 3 for sign in (-1, 1))
    chosen = {
        "straight, 2 m": Path(4.0, *PATHS["straight, 50 m"][1:]),
        "straight, 5 m": Path(10.0, *PATHS["straight, 50 m"][1:]),
        "straight, 10 m": Path(20.0, *PATHS["straight, 50 m"][1:]),
        "circle, 10 m": Path(20.0, *PATHS["circle R 0.5 m, 50 m"][1:]),
        "square, twice": PATHS["square, side 1 m, twice"],
        "figure of eight, 10 m": Path(20.0, *PATHS["figure of eight, 40 m"][1:]),
        "random": random_path(7),
    }
    rows = []
    values = []
    for seed, (name, path) in enumerate(chosen.items()):
        values.append(nees(runs, path, seed))
        inside = "inside" if low <= values[-1] <= high else "outside"
        rows.append([name, number(values[-1]), inside])
    section.table(
        f"Average NEES over 3 of {runs} runs with noisy wheels; 99 % bounds {number(low)} to "
        f"{number(high)}. It includes that a wandering heading shortens the way. The last metres "
        "of a long straight drive scatter more than these bounds, which assume Gaussian errors.",
        ["path", "NEES / 3", "bounds"],
        rows,
    )
    outside = sum(row[2] == "outside" for row in rows)
    section.findings.append(
        f"The covariance fits the errors: its NEES is {number(min(values))} to "
        f"{number(max(values))} times the expected value, inside the 99 % bounds on "
        f"{len(rows) - outside} of {len(rows)} paths."
    )


LINES = ("-", "--", "-", "-", "-")
"""Both Euler formulas err alike, so one line is dashed and shows the other."""


def draw(
    section: Section, found: dict[str, list[float]], spread: dict[str, list[float]], images: File
) -> None:
    """Draw the plots."""
    figure, axes = pictures.blank(7.5, 4.6)
    for (formula, values), colour, line in zip(found.items(), pictures.COLOURS, LINES, strict=True):
        axes.loglog(SLOPE_RATES_HZ, values, "o" + line, color=colour, label=formula, markersize=4)
    axes.axhline(
        floor(truth(PATHS["figure of eight, 40 m"]))[0], color="black", linestyle=":", linewidth=1,
        label="the encoders' own floor",
    )  # fmt: skip
    axes.set(xlabel="samples a second", ylabel="largest error of position, mm")
    axes.set_xticks(SLOPE_RATES_HZ, [str(rate) for rate in SLOPE_RATES_HZ])
    axes.minorticks_off()
    axes.legend(fontsize=8, frameon=False)
    caption = "The error of each formula by sampling rate, on a figure of eight of 40 m at 0.5 m/s."
    pictures.keep(section, figure, images, "convergence.png", caption)
    figure, axes = pictures.blank()
    pictures.shares(axes, spread, lines=LINES)
    axes.set(
        xlabel="largest error of position along the path, mm (20 Hz, whole counts)",
        ylabel="share of the random paths",
    )
    caption = (
        f"{len(spread[OURS])} random paths of 20 s: the share whose error stays below a value."
    )
    pictures.keep(section, figure, images, "random_paths.png", caption)


def bench(*, short: bool, images: File) -> Section:
    """Measure all formulas, and the covariance."""
    section = Section(
        name="exactness",
        title="Exactness of the pose",
        about="The error of the published pose against the truth, beside the errors of the "
        "formulas of linorobot2, `diff_drive_controller`, `mecanum_drive_controller` and an "
        "article's bridge on the same counts. It includes neither slip nor wrong wheel sizes.",
        how=method(__doc__)
        + f" Wheel radius {RADIUS_M} m. The formulas are those of their sources: linorobot2 uses "
        "the heading before the step in single precision, mecanum_drive_controller the heading "
        "after it, the article the heading in mid-step, and diff_drive_controller the arc.",
    )
    rates = (20,) if short else RATES_HZ
    tables_of_paths(section, rates)
    spread = table_of_random(section, 5 if short else 1000, rates)
    tables_of_records(section, rates)
    found = slopes(section)
    table_of_nees(section, 3 if short else 200)
    draw(section, found, spread, images)
    return section
