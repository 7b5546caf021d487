"""Gains for a motor: a formula, and the choice of its one free number on the fitted motors.

The formula is Skogestad's for a first-order lag with a dead time (*Simple analytic rules for
model reduction and PID controller tuning*, Journal of Process Control 13, 2003, table 1), for a
closed loop with the time constant λ:

    Kc = τ / (A (λ + θ))      Ti = min(τ, 4 (λ + θ))      so P = Kc, I = Kc T / Ti, D = 0

with the tick T. θ is one tick: outputs are held for a tick, half a tick on average, and a speed
counted over a tick is half a tick old. D stays 0: it would pass the steps of the counts on to the
motor.

λ is the one that settles soonest on every fitted motor without too much overshoot, also on motors
whose gain and lag are off by 25 %. These simulated motors have their remaining dead zone and the
resolution of their counts, which the formula ignores.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import msgspec

from yahboomd.tools.tune.estimates.loop_model import Gains, LoopModel, run
from yahboomd.tools.tune.estimates.step_response import figures, speeds

LAMBDAS = tuple(0.02 * 1.2**step for step in range(16))
"""From 20 to 300 ms. Behaviour faster than two ticks depends on effects outside the model."""

OFF = 1.25
"""The factor by which gain and lag may differ from the fit."""

OVERSHOOT = 0.03
"""The most on a model; a measured step may have 5 %."""

RUN_S = 1.5
DECIMALS = 3
"""Of a stored gain."""


class Suggestion(msgspec.Struct, frozen=True, kw_only=True):
    """Gains, and their predicted behaviour.

    Attributes:
        lambda_s: The time constant of the closed loop that they are made for.
        overshoot: The largest on any of the fitted motors, as a share of the step.
        settling_s: The longest; None if one does not settle.
    """

    gains: Gains
    lambda_s: float
    overshoot: float
    settling_s: float | None


def formula(model: LoopModel, lambda_s: float, tick_s: float) -> Gains:
    """The gains that give one motor a closed loop with the time constant ``lambda_s``."""
    horizon_s = lambda_s + tick_s
    gain = model.lag_s / (model.gain * horizon_s)
    integral_s = min(model.lag_s, 4.0 * horizon_s)
    return Gains(round(gain, DECIMALS), round(gain * tick_s / integral_s, DECIMALS), 0.0)


def suggest(
    models: Sequence[LoopModel],
    target: float,
    *,
    tick_s: float,
    count: float,
    least_lambda_s: float = 0.0,
) -> Suggestion:
    """One set of gains for all motors, as the board stores them.

    Args:
        count: Travel of one count.
        least_lambda_s: The fastest closed loop allowed, since an earlier one was too fast.
    """
    middle = LoopModel(
        gain=_middle([model.gain for model in models]),
        lag_s=_middle([model.lag_s for model in models]),
        gap=0.0,
        fastest=math.inf,
    )
    found = []
    for lambda_s in LAMBDAS:
        if lambda_s < least_lambda_s:
            continue
        gains = formula(middle, lambda_s, tick_s)
        overshoot, settling_s = _worst(models, gains, target, tick_s, count)
        doubted, _ = _worst(list(map(_off, models)), gains, target, tick_s, count)
        suggestion = Suggestion(
            gains=gains, lambda_s=lambda_s, overshoot=overshoot, settling_s=settling_s
        )
        found.append((max(overshoot, doubted - OVERSHOOT), suggestion))
    allowed = [each for overshoot, each in found if overshoot <= OVERSHOOT]
    if not allowed:
        return min(found, key=lambda each: each[0])[1]
    return min(allowed, key=lambda each: each.settling_s or math.inf)


def _worst(
    models: Sequence[LoopModel], gains: Gains, target: float, tick_s: float, count: float
) -> tuple[float, float | None]:
    runs = [
        run(model, gains, target, tick_s=tick_s, ticks=round(RUN_S / tick_s), count=count)
        for model in models
    ]
    settled = [figures(speeds(travel, tick_s), target, tick_s).settling_s for travel in runs]
    # Take the overshoot of single ticks, which a window of counts would smooth away.
    highest = max(after - before for travel in runs for before, after in pairwise(travel))
    overshoot = max(0.0, highest / tick_s / target - 1.0)
    known = [each for each in settled if each is not None]
    return overshoot, max(known) if len(known) == len(settled) else None


def _off(model: LoopModel) -> LoopModel:
    return msgspec.structs.replace(model, gain=model.gain * OFF, lag_s=model.lag_s / OFF)


def _middle(values: Sequence[float]) -> float:
    return math.exp(sum(map(math.log, values)) / len(values))
