"""The factors that explain all runs at once: generalised least squares over the counts.

The model: each wheel's travel is its counts times its radius, plus slip whose variance grows with
the distance; each measurement has an error of its own. The covariance of a run's measurement is
then ``Σ gᵢ gᵢᵀ k |dᵢ| + R`` with ``gᵢ`` the change of the end by a unit of travel in step i, ``dᵢ``
that travel, ``k`` the slip and ``R`` the tape's; the factors that minimise ``Σ eᵀ S⁻¹ e`` are the
most probable ones (Gauss-Newton; Nocedal and Wright, *Numerical Optimization*, section 10.3). The
inverse of the normal matrix is their covariance. Borenstein and Feng's UMBmark (1996) evaluates the
same squares by formulas that assume small errors, and needs several passes on a narrow base.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from yahboomd.tools.calibrate.estimates.runs import Factors, Floats, Run, path

SLIP_M_PER_SQRT_M = 0.01 * 0.1**0.5
"""Slip of 1 % of a wheel's travel in every 0.1 m: its deviation after one metre."""

STEPS_MAX = 50
CONVERGED = 1e-10
PROBE = 1e-6

SEEN = 1e-12
"""Smallest eigenvalue of the scaled normal matrix; below it, a factor changes no measurement."""

PARTS: tuple[str, ...] = Factors._fields

NOMINAL = Factors()


@dataclass(frozen=True)
class Fit:
    """The factors found, and how well they are known.

    Attributes:
        factors: The most probable factors.
        std: The deviation of each, as a fraction; 0 for factors that were not free.
        chi_squared: The weighted sum of squared residuals over its expected value: near 1 if slip
            and tape explain them, and 1 if there are none by construction.
        errors: The residuals of each run, in the units of its measurement.
    """

    factors: Factors
    std: Factors
    chi_squared: float
    errors: tuple[tuple[float, ...], ...]


class Unseen(Exception):
    """The runs do not determine every factor.

    Attributes:
        part: The undetermined one: ``scale``, ``ratio`` or ``track``.
    """

    def __init__(self, part: str) -> None:
        super().__init__(part)
        self.part = part


def fit(
    runs: Sequence[Run],
    *,
    free: Sequence[str] = PARTS,
    start: Factors = NOMINAL,
    slip: float = SLIP_M_PER_SQRT_M,
) -> Fit:
    """Find the factors that explain all runs.

    Args:
        free: The factors to find; the others keep their values in ``start``.
        slip: Deviation of a rim's travel by slip after one metre, metres.

    Raises:
        Unseen: Some combination of the free factors changes none of the measurements.
    """
    chosen = [PARTS.index(part) for part in free]
    values = np.array(start)
    covariance = np.zeros((len(chosen), len(chosen)))
    for _ in range(STEPS_MAX):
        factors = Factors(*values)
        normal, gradient = np.zeros((len(chosen), len(chosen))), np.zeros(len(chosen))
        for run in runs:
            weight = np.linalg.inv(measurement_covariance(run, factors, slip=slip))
            slope = _slope(run, values, chosen)
            normal += slope.T @ weight @ slope
            gradient += slope.T @ weight @ error(run, factors)
        covariance = _inverse(normal, free)
        change = covariance @ gradient
        values[chosen] += change
        if np.abs(change).max() < CONVERGED:
            break
    found = Factors(*map(float, values))
    errors = [error(run, found) for run in runs]
    squares = sum(
        float(each @ np.linalg.solve(measurement_covariance(run, found, slip=slip), each))
        for run, each in zip(runs, errors, strict=True)
    )
    freedoms = sum(len(each) for each in errors) - len(chosen)
    std = np.zeros(len(PARTS))
    std[chosen] = np.sqrt(np.diag(covariance)) / values[chosen]
    return Fit(
        factors=found,
        std=Factors(*map(float, std)),
        chi_squared=squares / freedoms if freedoms > 0 else 1.0,
        errors=tuple(tuple(map(float, each)) for each in errors),
    )


def predicted(run: Run, factors: Factors) -> Floats:
    """The measurements that these factors would give without slip."""
    x, y, heading = path(run, factors)
    if run.kind == "straight":
        return np.array([np.hypot(x[-1], y[-1])])
    if run.kind == "turn":
        return np.array([heading[-1]])
    return np.array([x[-1], y[-1], heading[-1]])[: len(run.measured)]


def error(run: Run, factors: Factors) -> Floats:
    """Measured minus predicted; a pose's heading within half a turn."""
    difference: Floats = np.array(run.measured) - predicted(run, factors)
    if run.kind == "pose" and len(difference) == 3:
        difference[2] = (difference[2] + np.pi) % (2.0 * np.pi) - np.pi
    return difference


def measurement_covariance(run: Run, factors: Factors, *, slip: float) -> Floats:
    """The covariance of a run's measurement, by slip on the way and by the tape."""
    x, y, heading = path(run, factors)
    middle = (heading[1:] + heading[:-1]) / 2.0
    track = factors.track * run.separation_m
    # A turn in step i carries the rest of the path about the point of step i.
    to_end_x, to_end_y = x[-1] - x[:-1], y[-1] - y[:-1]
    end = np.zeros((3, 3))
    for side, travel in ((-1.0, run.left), (1.0, run.right)):
        by_unit = np.stack(
            (
                np.cos(middle) / 2.0 - to_end_y * side / track,
                np.sin(middle) / 2.0 + to_end_x * side / track,
                np.full(len(travel), side / track),
            )
        )
        end += (by_unit * np.abs(travel)) @ by_unit.T * slip**2
    tape = np.diag(np.square(run.std))
    count = len(run.measured)
    slipped: Floats = end[:count, :count]
    if run.kind == "straight":
        along = np.array([x[-1], y[-1], 0.0]) / max(float(np.hypot(x[-1], y[-1])), 1e-9)
        slipped = np.array([[along @ end @ along]])
    elif run.kind == "turn":
        slipped = end[2:, 2:]
    whole: Floats = slipped + tape
    return whole


def _slope(run: Run, values: Floats, chosen: Sequence[int]) -> Floats:
    """The derivative of the prediction by each chosen factor, by central differences."""
    columns = []
    for step in np.eye(len(values))[list(chosen)] * PROBE:
        above, below = Factors(*(values + step)), Factors(*(values - step))
        columns.append((predicted(run, above) - predicted(run, below)) / (2.0 * PROBE))
    return np.stack(columns, axis=1)


def _inverse(normal: Floats, free: Sequence[str]) -> Floats:
    """Invert a normal matrix; raise if some direction is undetermined."""
    size = np.sqrt(np.diag(normal))
    if not size.all():
        raise Unseen(free[int(np.argmin(size))])
    scaled = normal / np.outer(size, size)
    values, vectors = np.linalg.eigh(scaled)
    if values[0] < SEEN:
        raise Unseen(free[int(np.argmax(np.abs(vectors[:, 0])))])
    inverse: Floats = np.linalg.inv(scaled) / np.outer(size, size)
    return inverse
