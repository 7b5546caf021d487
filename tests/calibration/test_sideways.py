"""The way of a mecanum base to the side, whatever else it does meanwhile."""

from __future__ import annotations

import math

import numpy as np
import pytest

from yahboomd.tools.calibrate.estimates.least_squares import SLIP_M_PER_SQRT_M, Unseen
from yahboomd.tools.calibrate.estimates.sideways import SidewaysRun, fit_sideways

STEPS = 200
SURE = {"scale": 1.0, "track": 1.0, "scale_std": 0.0}


def run(
    metres: float, factor: float, *, ahead: float = 0.0, turn: float = 0.0, scale: float = 1.0
) -> SidewaysRun:
    """A run whose true end is integrated step by step."""
    x = y = heading = 0.0
    for _ in range(STEPS):
        step_turn = turn * scale / STEPS
        middle = heading + step_turn / 2.0
        dx, dy = scale * ahead / STEPS, scale * factor * metres / STEPS
        x += math.cos(middle) * dx - math.sin(middle) * dy
        y += math.sin(middle) * dx + math.cos(middle) * dy
        heading += step_turn
    each = [np.full(STEPS, whole / STEPS) for whole in (ahead, metres, turn)]
    return SidewaysRun(*each, math.hypot(x, y), 0.002)


@pytest.mark.parametrize("metres", [1.0, -1.0])
@pytest.mark.parametrize(("ahead", "turn"), [(0.0, 0.0), (0.05, 0.2), (-0.05, -0.3)])
def test_the_factor_is_found_though_the_base_turns_and_creeps(
    metres: float, ahead: float, turn: float
) -> None:
    found = fit_sideways([run(metres, 0.87, ahead=ahead, turn=turn)], **SURE)
    assert found.factor == pytest.approx(0.87, rel=1e-4)


def test_the_size_of_the_wheels_is_no_part_of_it_and_makes_it_less_sure() -> None:
    found = fit_sideways(
        [run(1.0, 0.9, scale=1.05), run(-1.0, 0.9, scale=1.05)],
        scale=1.05,
        track=1.0,
        scale_std=0.003,
    )
    assert found.factor == pytest.approx(0.9, rel=1e-9)
    slip_m2 = SLIP_M_PER_SQRT_M**2 / 4.0
    alone = math.sqrt((0.002**2 + slip_m2) / 2.0) / (0.9 * 1.05)
    assert found.std == pytest.approx(math.hypot(alone, 0.003))


def test_noise_of_slip_and_tape_is_as_large_as_it_says() -> None:
    chance = np.random.default_rng(1)
    errors = []
    for _ in range(300):
        runs = []
        for metres in (1.0, -1.0):
            exact = run(metres, 0.85)
            # Each wheel slips by itself; the base goes to the side by their mean.
            slip_m = SLIP_M_PER_SQRT_M * chance.normal(size=4).mean()
            measured = exact.measured + slip_m + chance.normal(scale=0.002)
            runs.append(SidewaysRun(exact.ahead, exact.left, exact.turn, measured, 0.002))
        found = fit_sideways(runs, **SURE)
        errors.append((found.factor / 0.85 - 1.0) / found.std)
    assert np.std(errors) == pytest.approx(1.0, abs=0.1)
    assert abs(np.mean(errors)) < 0.2


def test_sides_that_differ_say_by_how_much() -> None:
    found = fit_sideways([run(1.0, 0.9), run(-1.0, 0.8)], **SURE)
    assert found.apart == pytest.approx(0.1 / 0.85, rel=0.02)


def test_a_run_that_went_nowhere_to_the_side_shows_nothing() -> None:
    with pytest.raises(Unseen) as error:
        fit_sideways([run(0.0, 0.9, ahead=1.0)], **SURE)
    assert error.value.part == "sideways"
    less = run(1.0, 0.9, ahead=1.0)
    short = SidewaysRun(less.ahead, less.left, less.turn, 0.2, 0.002)
    with pytest.raises(Unseen):
        fit_sideways([short], **SURE)
