"""True paths and the travel of the wheels: arrays over time, exact to a micrometre.

A path is a speed and a heading over time. Simpson's rule over milliseconds gives positions and the
travel of the wheels: left is s - θ b/2, right is s + θ b/2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

TRACK_M = 0.17
RADIUS_M = 0.0335
TICKS = 1320.0
TICK_M = 2.0 * math.pi * RADIUS_M / TICKS
FINE_HZ = 1000

Array = NDArray[np.float64]
Over = Callable[[Array], Array]


class Path(NamedTuple):
    """A path of the base.

    Attributes:
        seconds: Its duration.
        speed: m/s over seconds.
        heading: Radians over seconds, 0 at 0.
    """

    seconds: float
    speed: Over
    heading: Over


class Truth(NamedTuple):
    """Positions and travel every millisecond."""

    x: Array
    y: Array
    theta: Array
    left: Array
    right: Array

    def at(self, rate_hz: int) -> Truth:
        """The same at a lower rate."""
        return Truth(*(each[:: FINE_HZ // rate_hz] for each in self))


def _swell(t: Array, begin: float, length: float) -> Array:
    """A smooth step from 0 to 1 over ``length`` seconds from ``begin`` on."""
    u = np.clip((t - begin) / length, 0.0, 1.0)
    return u - np.sin(2.0 * np.pi * u) / (2.0 * np.pi)


def _square_speed(t: Array) -> Array:
    # Two seconds a side and one a corner: 1 m at 0.5 m/s on average.
    u = np.clip(t % 3.0 / 2.0, 0.0, 1.0)
    return 0.5 * (1.0 - np.cos(2.0 * np.pi * u))


def _square_heading(t: Array) -> Array:
    corners = np.zeros_like(t)
    for n in range(8):
        corners += _swell(t, 3.0 * n + 2.0, 1.0)
    return corners * np.pi / 2.0


def random_path(seed: int, seconds: float = 20.0) -> Path:
    """Waves of heading and of speed; up to 0.5 m/s, some backward."""
    chance = np.random.default_rng(seed)
    size, rate, phase = (chance.uniform(a, b, 5) for a, b in ((0.2, 1.2), (0.3, 1.5), (0.0, 6.3)))
    mean, swing, beat, start = (
        chance.uniform(a, b) for a, b in ((0.0, 0.3), (0.0, 0.2), (0.2, 1.0), (0.0, 6.3))
    )

    def heading(t: Array) -> Array:
        waves = size[:, None] * (
            np.sin(rate[:, None] * t + phase[:, None]) - np.sin(phase)[:, None]
        )
        total: Array = waves.sum(axis=0)
        return total

    return Path(seconds, lambda t: mean + swing * np.sin(beat * t + start), heading)


def _steady(t: Array) -> Array:
    return np.full_like(t, 0.5)


PATHS: dict[str, Path] = {
    "straight, 50 m": Path(100.0, _steady, np.zeros_like),
    "circle R 0.5 m, 50 m": Path(100.0, _steady, lambda t: t),
    "square, side 1 m, twice": Path(24.0, _square_speed, _square_heading),
    # The heading of a figure of eight swings by 2.4 rad either way: that of a lemniscate, nearly.
    "figure of eight, 40 m": Path(80.0, _steady, lambda t: 2.4 * np.sin(2.0 * np.pi * t / 10.0)),
}


def truth(path: Path) -> Truth:
    """Integrate a path."""
    count = round(path.seconds * FINE_HZ)
    h = 1.0 / FINE_HZ
    # Every half millisecond: Simpson's rule needs the middles.
    t = np.arange(2 * count + 1) * (h / 2.0)
    speed, theta = path.speed(t), path.heading(t)

    def integral(values: Array) -> Array:
        pieces = (values[:-2:2] + 4.0 * values[1::2] + values[2::2]) * (h / 6.0)
        return np.concatenate(([0.0], np.cumsum(pieces)))

    s = integral(speed)
    turned = theta[::2] * TRACK_M / 2.0
    return Truth(
        integral(speed * np.cos(theta)),
        integral(speed * np.sin(theta)),
        theta[::2],
        s - turned,
        s + turned,
    )


def counts(travel: Array, ticks: float, offset: float) -> NDArray[np.int64]:
    """The counts of an encoder."""
    per_tick = 2.0 * math.pi * RADIUS_M / ticks
    return np.floor(travel / per_tick + offset).astype(np.int64)
