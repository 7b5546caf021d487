"""How far integration formulas stray, on the same wheel travel: the table of docs/odometry.md.

    python benchmarks/odometry_table.py

Largest distance from the true path, in mm, along paths of constant speed. "exact" hands the
formulas the wheels' travel as it is, which leaves their own error; "counted" hands them whole ticks
of an encoder with 1320 counts and a wheel of 67 mm, and shows the floor that no formula gets below.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from itertools import pairwise

from yahboomd.model import Kinematics, Motor
from yahboomd.odometry.integrator import Integrator

TRACK_M = 0.17
RADIUS_M = 0.0335
TICKS = 1320.0
FINE_TICKS = 1e13
RATES_HZ = (10, 20, 50, 100)
FINE_HZ = 10_000

Path = tuple[float, float, Callable[[float], float]]
"""Seconds, speed in m/s, and heading in radians over seconds."""


def random_heading(seed: int) -> Callable[[float], float]:
    chance = random.Random(seed)
    waves = [
        (chance.uniform(0.2, 1.2), chance.uniform(0, 6.3), chance.uniform(0.3, 1.0))
        for _ in range(5)
    ]
    start = sum(size * math.sin(phase) for _, phase, size in waves)
    return lambda t: sum(size * math.sin(rate * t + phase) for rate, phase, size in waves) - start


PATHS: dict[str, Path] = {
    "straight, 50 m": (100.0, 0.5, lambda _: 0.0),
    "circle R 0.5 m, 50 m": (100.0, 0.5, lambda t: t),
    # The heading of a figure of eight swings by 2.4 rad either way: that of a lemniscate, nearly.
    "figure of eight, 40 m": (80.0, 0.5, lambda t: 2.4 * math.sin(2.0 * math.pi * t / 10.0)),
    "random, 35 m": (70.0, 0.5, random_heading(1)),
}


def true_path(path: Path) -> list[tuple[float, float]]:
    """Places at the highest of the rates, by Simpson's rule over tenths of a millisecond."""
    seconds, speed, heading = path
    rate_hz = RATES_HZ[-1]
    x = y = 0.0
    places = [(0.0, 0.0)]
    fine = FINE_HZ // rate_hz
    h = 1.0 / FINE_HZ
    for n in range(round(seconds * rate_hz)):
        for k in range(fine):
            t = (n * fine + k) * h
            a, b, c = heading(t), heading(t + h / 2), heading(t + h)
            x += speed * h * (math.cos(a) + 4.0 * math.cos(b) + math.cos(c)) / 6.0
            y += speed * h * (math.sin(a) + 4.0 * math.sin(b) + math.sin(c)) / 6.0
        places.append((x, y))
    return places


def wheel_travel(path: Path, rate_hz: int) -> list[tuple[float, float]]:
    seconds, speed, heading = path
    travel = []
    for n in range(round(seconds * rate_hz) + 1):
        t = n / rate_hz
        turned = heading(t) * TRACK_M / 2.0
        travel.append((speed * t - turned, speed * t + turned))
    return travel


def counted(
    travel: list[tuple[float, float]], ticks: float, offset: float
) -> list[tuple[int, int]]:
    per_tick = 2.0 * math.pi * RADIUS_M / ticks
    return [
        (math.floor(a / per_tick + offset), math.floor(b / per_tick + offset / 3))
        for a, b in travel
    ]


def simple(counts: list[tuple[int, int]], ticks: float, share: float) -> list[tuple[float, float]]:
    """Euler (share 0: the heading before the step) and midpoint (share 0.5)."""
    per_tick = 2.0 * math.pi * RADIUS_M / ticks
    x = y = theta = 0.0
    places = [(x, y)]
    for (a0, b0), (a1, b1) in pairwise(counts):
        ds = (a1 - a0 + b1 - b0) * per_tick / 2.0
        turn = (b1 - b0 - a1 + a0) * per_tick / TRACK_M
        x += ds * math.cos(theta + share * turn)
        y += ds * math.sin(theta + share * turn)
        theta += turn
        places.append((x, y))
    return places


def ours(
    counts: list[tuple[int, int]], ticks: float, *, corrected: bool
) -> list[tuple[float, float]]:
    kinematics = Kinematics(
        name="differential",
        wheels=("left", "right"),
        inverse=((1.0, 0.0, -TRACK_M / 2), (1.0, 0.0, TRACK_M / 2)),
        forward=((0.5, 0.5), (0.0, 0.0), (-1.0 / TRACK_M, 1.0 / TRACK_M)),
    )
    motors = tuple(
        Motor(name=name, wheel=n, position=n + 1, radius_m=RADIUS_M, ticks_per_revolution=ticks)
        for n, name in enumerate(kinematics.wheels)
    )
    integrator = Integrator(kinematics, motors, corrected=corrected)
    first = counts[0]
    places = [(0.0, 0.0)]
    for (a0, b0), (a1, b1) in pairwise(counts):
        integrator.step((a1 - a0, b1 - b0), (a1 - first[0], b1 - first[1]), 1)
        places.append((integrator.pose.x, integrator.pose.y))
    return places


FORMULAS: dict[str, Callable[[list[tuple[int, int]], float], list[tuple[float, float]]]] = {
    "Euler": lambda counts, ticks: simple(counts, ticks, 0.0),
    "midpoint": lambda counts, ticks: simple(counts, ticks, 0.5),
    "arc": lambda counts, ticks: ours(counts, ticks, corrected=False),
    "arc + correction": lambda counts, ticks: ours(counts, ticks, corrected=True),
}


def worst_mm(places: list[tuple[float, float]], truth: list[tuple[float, float]]) -> float:
    return 1000.0 * max(math.dist(a, b) for a, b in zip(places, truth, strict=True))


def digits(value: float) -> str:
    return f"{value:.0f}" if value >= 9.95 else f"{value:.2g}" if value >= 1e-5 else "0"


def main() -> None:
    for title, ticks, offset in (("exact", FINE_TICKS, 0.5), ("counted", TICKS, 0.7)):
        print(f"\n{title}: largest error in mm at {' / '.join(map(str, RATES_HZ))} Hz\n")
        print("| path | " + " | ".join(FORMULAS) + " |")
        print("|---" * (len(FORMULAS) + 1) + "|")
        for name, path in PATHS.items():
            cells: dict[str, list[str]] = {formula: [] for formula in FORMULAS}
            places = true_path(path)
            for rate_hz in RATES_HZ:
                truth = places[:: RATES_HZ[-1] // rate_hz]
                counts = counted(wheel_travel(path, rate_hz), ticks, offset)
                for formula, integrate in FORMULAS.items():
                    cells[formula].append(digits(worst_mm(integrate(counts, ticks), truth)))
            row = " | ".join(" / ".join(cells[formula]) for formula in FORMULAS)
            print(f"| {name} | {row} |")


if __name__ == "__main__":
    main()
