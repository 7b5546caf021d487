"""Runs of the robot: the counted travel of its two sides, and a measurement by a person."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

Floats: TypeAlias = npt.NDArray[np.float64]

Kind: TypeAlias = Literal["straight", "turn", "pose"]


class Factors(NamedTuple):
    """The true size of the robot, as multiples of the size that the travel was computed with.

    Attributes:
        scale: The mean of both radii.
        ratio: The right radius over the left one.
        track: The distance between the sides.
    """

    scale: float = 1.0
    ratio: float = 1.0
    track: float = 1.0

    @property
    def left(self) -> float:
        """The left radius."""
        return 2.0 * self.scale / (1.0 + self.ratio)

    @property
    def right(self) -> float:
        """The right radius."""
        return self.left * self.ratio


@dataclass(frozen=True)
class Run:
    """One run, from standstill to standstill.

    Attributes:
        kind: The kind of measurement in ``measured``.
        left: Travel of the left rim in each step by its counts and its nominal radius, metres.
        right: The same of the right rim.
        separation_m: The nominal distance between the sides.
        measured: Of a ``straight``: (metres between start and end). Of a ``turn``: (radians,
            counter-clockwise, whole turns included). Of a ``pose``: the end (x, y, heading) as seen
            from the start, metres and radians; the heading may be any number of turns off.
        std: The standard deviation of each number of ``measured``, in its unit.
    """

    kind: Kind
    left: Floats
    right: Floats
    separation_m: float
    measured: tuple[float, ...]
    std: tuple[float, ...]

    @property
    def travel_m(self) -> float:
        """The travel of the middle by the counts, forward and back alike."""
        return float(np.abs(self.left + self.right).sum() / 2.0)

    @property
    def turned_rad(self) -> float:
        """The turn by the counts, with its sign."""
        return float((self.right - self.left).sum() / self.separation_m)


class Path(NamedTuple):
    """The path by the counts, for given factors: n + 1 points of n steps.

    Attributes:
        x: Metres, forward of the start.
        y: Metres, to the left of the start.
        heading: Radians; not wrapped.
    """

    x: Floats
    y: Floats
    heading: Floats


def path(run: Run, factors: Factors) -> Path:
    """The path of a run: the exact arc of each step (Lynch and Park, section 3.2.3)."""
    left, right = factors.left * run.left, factors.right * run.right
    turn = (right - left) / (factors.track * run.separation_m)
    heading = np.concatenate(([0.0], np.cumsum(turn)))
    middle = heading[:-1] + turn / 2.0
    # numpy's sinc is that of sin(pi x) / (pi x).
    chord = (left + right) / 2.0 * np.sinc(turn / (2.0 * np.pi))
    x = np.concatenate(([0.0], np.cumsum(chord * np.cos(middle))))
    y = np.concatenate(([0.0], np.cumsum(chord * np.sin(middle))))
    return Path(x, y, heading)
