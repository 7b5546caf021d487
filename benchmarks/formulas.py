"""Formulas from counts to pose: published ones of other projects, and yahboomd's.

Each takes the counters of the left and of the right wheel and returns (x, y, theta), all at every
sample. The others' are their published formulas, rewritten for whole arrays.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from benchmarks.paths import RADIUS_M, TRACK_M, Array
from yahboomd.core.model import Kinematics, Motor
from yahboomd.core.odometry.integrator import Integrator

Counted = NDArray[np.int64]
Places = tuple[Array, Array, Array]


def _steps(left: Counted, right: Counted, ticks: float) -> tuple[Array, Array]:
    per_tick = 2.0 * math.pi * RADIUS_M / ticks
    a, b = np.diff(left) * per_tick, np.diff(right) * per_tick
    return (a + b) / 2.0, (b - a) / TRACK_M


def _summed(dx: Array, dy: Array, theta: Array) -> Places:
    start = np.zeros(1)
    return np.concatenate((start, np.cumsum(dx))), np.concatenate((start, np.cumsum(dy))), theta


def _headings(turns: Array) -> Array:
    return np.concatenate((np.zeros(1), np.cumsum(turns)))


def euler(left: Counted, right: Counted, ticks: float) -> Places:
    """linorobot2: forward Euler with the heading before the step, in single precision."""
    ds, turns = (each.astype(np.float32) for each in _steps(left, right, ticks))
    zero = np.zeros(1, np.float32)
    # np.cumsum of float32 adds one after the other in float32, as a microcontroller does.
    theta = np.concatenate((zero, np.cumsum(turns, dtype=np.float32)))
    x = np.cumsum(ds * np.cos(theta[:-1]), dtype=np.float32)
    y = np.cumsum(ds * np.sin(theta[:-1]), dtype=np.float32)
    return tuple(
        each.astype(np.float64)
        for each in (np.concatenate((zero, x)), np.concatenate((zero, y)), theta)
    )  # type: ignore[return-value]


def backward(left: Counted, right: Counted, ticks: float) -> Places:
    """mecanum_drive_controller: Euler with the heading after the step."""
    ds, turns = _steps(left, right, ticks)
    theta = _headings(turns)
    return _summed(ds * np.cos(theta[1:]), ds * np.sin(theta[1:]), theta)


def midpoint(left: Counted, right: Counted, ticks: float) -> Places:
    """The article: the heading in mid-step."""
    ds, turns = _steps(left, right, ticks)
    theta = _headings(turns)
    middle = theta[:-1] + turns / 2.0
    return _summed(ds * np.cos(middle), ds * np.sin(middle), theta)


def exact_arc(left: Counted, right: Counted, ticks: float) -> Places:
    """diff_drive_controller: r (sin θ' - sin θ); the midpoint for turns below 1e-6 rad."""
    ds, turns = _steps(left, right, ticks)
    theta = _headings(turns)
    straight = np.abs(turns) < 1e-6
    radius = ds / np.where(straight, 1.0, turns)
    middle = theta[:-1] + turns / 2.0
    dx = np.where(straight, ds * np.cos(middle), radius * np.diff(np.sin(theta)))
    dy = np.where(straight, ds * np.sin(middle), -radius * np.diff(np.cos(theta)))
    return _summed(dx, dy, theta)


KINEMATICS = Kinematics(
    name="differential",
    wheels=("left", "right"),
    inverse=((1.0, 0.0, -TRACK_M / 2), (1.0, 0.0, TRACK_M / 2)),
    forward=((0.5, 0.5), (0.0, 0.0), (-1.0 / TRACK_M, 1.0 / TRACK_M)),
)


def motors(ticks: float) -> tuple[Motor, ...]:
    """Two motors."""
    return tuple(
        Motor(name=name, wheel=n, position=n + 1, radius_m=RADIUS_M, ticks_per_revolution=ticks)
        for n, name in enumerate(KINEMATICS.wheels)
    )


def yahboomd(left: Counted, right: Counted, ticks: float) -> Places:
    """The daemon's own integrator: arc and correction, heading from totals."""
    integrator = Integrator(KINEMATICS, motors(ticks))
    places = [(0.0, 0.0, 0.0)]
    totals = list(zip((left - left[0]).tolist(), (right - right[0]).tolist(), strict=True))
    for before, now in pairwise(totals):
        integrator.integrate((now[0] - before[0], now[1] - before[1]), now, 1)
        pose = integrator.pose
        places.append((pose.x, pose.y, pose.theta))
    x, y, theta = np.array(places).T
    return x, y, theta


FORMULAS: dict[str, Callable[[Counted, Counted, float], Places]] = {
    "Euler, float32 (linorobot2)": euler,
    "heading after the step (mecanum_drive_controller)": backward,
    "midpoint (the article)": midpoint,
    "arc (diff_drive_controller)": exact_arc,
    "yahboomd": yahboomd,
}
OURS = "yahboomd"
