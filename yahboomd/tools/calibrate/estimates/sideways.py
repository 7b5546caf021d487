"""The way of a mecanum base to the side, for each metre that its wheels count.

Its rollers slip most in sideways motion, by 5 to 20 % of the way, and about as much at any speed.
So one factor is measured by runs to the side. A base also turns and creeps a little meanwhile: the
end of a run, for the factor ``s``, is ``F + s G`` with ``F`` the sum of its steps ahead and ``G``
that of its steps to the side, each along the heading of its step. A tape measures its distance
``d`` from the start, so ``s`` is the positive root of ``|F + s G|^2 = d^2``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from yahboomd.tools.calibrate.estimates.least_squares import SLIP_M_PER_SQRT_M, Unseen
from yahboomd.tools.calibrate.estimates.runs import Floats


@dataclass(frozen=True)
class SidewaysRun:
    """One run to the side, from standstill to standstill, with nominal radii and track.

    Attributes:
        ahead: Travel ahead in each step by the counts, metres.
        left: Travel to the left, metres.
        turn: Counter-clockwise turn, radians.
        measured: Metres between start and end.
    """

    ahead: Floats
    left: Floats
    turn: Floats
    measured: float
    std: float

    @property
    def travel_m(self) -> float:
        """The travel to the side by the counts, both ways alike."""
        return float(np.abs(self.left).sum())


@dataclass(frozen=True)
class Sideways:
    """The factor found.

    Attributes:
        factor: The true way to the side for each metre that the wheels count, of their true size.
        std: Its deviation, as a fraction.
        apart: The largest difference between the factors of single runs, as a fraction.
    """

    factor: float
    std: float
    apart: float


def fit_sideways(
    runs: Sequence[SidewaysRun], *, scale: float, track: float, scale_std: float
) -> Sideways:
    """The factor of all runs.

    Args:
        scale: The true size of the wheels, as a multiple of the nominal one.
        track: The same of the distance between the sides.
        scale_std: The deviation of ``scale``, as a fraction.

    Raises:
        Unseen: A run went no way to the side.
    """
    factors, variances = [], []
    for run in runs:
        along, across = _ends(run, scale, track)
        square = float(across @ across)
        if square <= 0.0:
            raise Unseen("sideways")
        beside = float(along @ across)
        root = beside * beside - square * (float(along @ along) - run.measured**2)
        if root <= 0.0:
            raise Unseen("sideways")
        factors.append((np.sqrt(root) - beside) / square)
        # Four wheels slip by themselves; the base moves as their mean.
        slip_m2 = SLIP_M_PER_SQRT_M**2 * run.travel_m / 4.0
        variances.append((run.std**2 + slip_m2) / square)
    weights = 1.0 / np.array(variances)
    factor = float(np.average(factors, weights=weights))
    spread = 1.0 / float(weights.sum())
    return Sideways(
        factor=factor,
        std=float(np.hypot(np.sqrt(spread) / factor, scale_std)),
        apart=float(max(factors) - min(factors)) / factor,
    )


def _ends(run: SidewaysRun, scale: float, track: float) -> tuple[Floats, Floats]:
    """The sums of the steps ahead, and of the steps to the side with the factor 1."""
    turn = run.turn * (scale / track)
    middle = np.cumsum(turn) - turn / 2.0
    chord = scale * np.sinc(turn / (2.0 * np.pi))
    cos, sin = np.cos(middle), np.sin(middle)
    along = np.array([(chord * run.ahead * cos).sum(), (chord * run.ahead * sin).sum()])
    across = np.array([-(chord * run.left * sin).sum(), (chord * run.left * cos).sum()])
    return along, across
