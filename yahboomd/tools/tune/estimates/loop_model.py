"""The speed loop of a board with a motor behind it, and its fit to measured steps.

The law of the loop, with the error e = target - measured, each tick:

    du = P (e - e1) + I e + D (e - 2 e1 + e2)

(the incremental, or velocity, form of PID; Åström and Hägglund, *PID Controllers: Theory, Design
and Tuning*, 1995, section 3.5). The motor's speed follows A |u| - B with a first-order lag: A is
the speed for one unit of output, B the speed lost to a dead zone that the board does not
compensate. Speeds are in the board's own command units.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from yahboomd.tools.tune.estimates.step_response import speeds

Floats = NDArray[np.float64]

ROUNDS = 30
DAMPING = 1e-2
PROBE = 1e-4
DONE = 1e-6

LATEST_TICKS = 2
"""A command acts within this many ticks."""

LEAST_LAG_S, MOST_LAG_S = 0.002, 2.0


class Gains(NamedTuple):
    """The gains of the loop."""

    p: float
    i: float
    d: float


class LoopModel(msgspec.Struct, frozen=True, kw_only=True):
    """A motor as its speed loop sees it.

    Attributes:
        gain: Speed for one unit of the loop's output (A).
        lag_s: Time constant of the motor.
        gap: Speed that a dead zone takes away (B).
        fastest: Speed at full output.
    """

    gain: float
    lag_s: float
    gap: float
    fastest: float


class Step(msgspec.Struct, frozen=True, kw_only=True):
    """A measured step from rest.

    Attributes:
        travel: Travel at each tick since the command, in units of speed times seconds.
        apart: Ticks from one reading of the counts to the next; between them travel is
            interpolated.
    """

    gains: Gains
    target: float
    travel: Sequence[float]
    apart: int = 1


def run(
    model: LoopModel, gains: Gains, target: float, *, tick_s: float, ticks: int, count: float = 0.0
) -> list[float]:
    """The travel at 0, 1, 2 ... ticks after a step from rest.

    Args:
        count: The travel of one count, the resolution of the loop's measurement; 0: continuous.
    """
    decay = math.exp(-tick_s / model.lag_s)
    carried = model.lag_s * (1.0 - decay)
    gain, gap, fastest = model.gain, model.gap, model.fastest
    p, i, d = gains
    speed = place = output = error1 = error2 = seen = 0.0
    travel = [0.0]
    for _ in range(ticks):
        counted = math.floor(place / count) * count if count else place
        error = target - (counted - seen) / tick_s
        seen = counted
        output += p * (error - error1) + i * error + d * (error - 2.0 * error1 + error2)
        error1, error2 = error, error1
        wanted = math.copysign(min(fastest, max(0.0, gain * abs(output) - gap)), output)
        place += wanted * tick_s + (speed - wanted) * carried
        speed = wanted + (speed - wanted) * decay
        travel.append(place)
    return travel


def fit(steps: Sequence[Step], *, tick_s: float, fastest: float) -> tuple[LoopModel, float]:
    """Fit a motor to steps (Levenberg and Marquardt, from a grid of start values).

    The delay from a command to its effect differs by milliseconds from step to step, so the fit may
    shift each step in time.

    Args:
        steps: Steps of one wheel, by one or several sets of gains.
        fastest: The first guess of the speed at full output.

    Returns:
        The motor, and the residual: root mean square, as a share of the step.
    """
    measured = [np.array(speeds(step.travel, tick_s)) for step in steps]

    def residual(point: Floats) -> Floats:
        model = _model(point)
        parts = []
        for step, seen in zip(steps, measured, strict=True):
            ticks = len(step.travel) - 1
            travel = run(model, step.gains, step.target, tick_s=tick_s, ticks=ticks)
            expected = np.array(speeds(_as_read(travel, step.apart), tick_s))
            parts.append(_shifted(seen, expected) / abs(step.target))
        return np.concatenate(parts)

    scale = max(abs(step.target) for step in steps)
    starts = [
        np.log([gain, lag_s, gap, fastest])
        for gain in (0.3, 1.0, 3.0, 10.0)
        for lag_s in (0.03, 0.1, 0.3)
        for gap in (0.03 * scale, 0.5 * scale, 2.0 * scale)
    ]
    costs = [float(np.sum(residual(start) ** 2)) for start in starts]
    best = min(
        (_descend(residual, starts[index]) for index in np.argsort(costs)[:3]),
        key=lambda found: found[1],
    )
    return _model(best[0]), math.sqrt(best[1] / sum(map(len, measured)))


def _as_read(travel: list[float], apart: int) -> Sequence[float]:
    """Travel interpolated between readings, averaged over all phases of the readings."""
    if apart == 1:
        return travel
    kernel = np.convolve(np.ones(apart), np.ones(apart)) / apart**2
    after = travel[-1] + (travel[-1] - travel[-2]) * np.arange(1, apart)
    padded = np.concatenate([np.zeros(apart - 1), np.array(travel), after])
    read: list[float] = np.convolve(padded, kernel, mode="valid").tolist()
    return read


def _model(point: Floats) -> LoopModel:
    gain, lag_s, gap, fastest = (math.exp(min(20.0, max(-20.0, value))) for value in point)
    lag_s = min(MOST_LAG_S, max(LEAST_LAG_S, lag_s))
    return LoopModel(gain=gain, lag_s=lag_s, gap=gap, fastest=fastest)


def _shifted(seen: Floats, expected: Floats) -> Floats:
    """The smallest difference over all shifts in time.

    Shifts are whole ticks, and fractions of a tick to first order.
    """
    best: Floats = seen - expected
    for ticks in range(LATEST_TICKS + 1):
        late = np.concatenate([np.zeros(ticks), expected[: len(expected) - ticks]])
        slope, difference = np.gradient(late), seen - late
        power = float(slope @ slope)
        shift = float(difference @ slope) / power if power > 0.0 else 0.0
        left = difference - min(0.6, max(-0.6, shift)) * slope
        if float(left @ left) < float(best @ best):
            best = left
    return best


def _descend(residual: Callable[[Floats], Floats], start: Floats) -> tuple[Floats, float]:
    point, left = start, residual(start)
    cost, damping = float(left @ left), DAMPING
    for _ in range(ROUNDS):
        columns = [(residual(point + PROBE * unit) - left) / PROBE for unit in np.eye(len(point))]
        slope = np.stack(columns, axis=1)
        normal, toward = slope.T @ slope, slope.T @ left
        moved = False
        for _ in range(6):
            step = np.linalg.solve(normal + damping * np.eye(len(point)), -toward)
            trial = point + np.clip(step, -0.7, 0.7)
            trial_left = residual(trial)
            trial_cost = float(trial_left @ trial_left)
            if trial_cost < cost:
                moved = cost - trial_cost > DONE * cost
                point, left, cost, damping = trial, trial_left, trial_cost, damping / 3.0
                break
            damping *= 4.0
        if not moved:
            break
    return point, cost
