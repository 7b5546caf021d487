"""A calibration is exact without noise, honest with it, and refuses what it cannot see."""

from __future__ import annotations

import math

import numpy as np
import pytest
from calibration_runs import (
    SIDE_M,
    STRAIGHT_M,
    TRACK_M,
    TRUE,
    SlippingRobot,
    exact,
    square,
    squares_and_straight,
    straight,
    turned,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from yahboomd.tools.calibrate.estimates.least_squares import PARTS, SLIP_M_PER_SQRT_M, Unseen, fit
from yahboomd.tools.calibrate.estimates.runs import Factors, Run
from yahboomd.tools.calibrate.estimates.verdict import unseen


@settings(max_examples=20)
@given(scale=st.floats(0.95, 1.05), ratio=st.floats(0.98, 1.02), track=st.floats(0.9, 1.1))
def test_squares_and_a_straight_give_any_robot_exactly(scale, ratio, track) -> None:
    true = Factors(scale, ratio, track)
    runs = [exact("pose", *square(SIDE_M, left=left), true) for left in (True, False)]
    found = fit([*runs, exact("straight", *straight(STRAIGHT_M), true)])
    assert found.factors == pytest.approx(true, rel=1e-7)
    assert np.abs(np.concatenate(found.errors)).max() < 1e-6


def test_a_tape_gives_size_and_track_of_a_robot_whose_wheels_are_alike() -> None:
    true = Factors(scale=1.03, track=1.08)
    runs = [exact("straight", *straight(2.0), true), exact("turn", *turned(10 * math.pi), true)]
    found = fit(runs, free=("scale", "track"))
    assert found.factors == pytest.approx(true, rel=1e-9)
    assert found.std.ratio == 0.0, "it was not measured"


def test_a_factor_that_is_not_free_stays_as_it_is() -> None:
    true = Factors(scale=1.03, ratio=1.01, track=1.08)
    runs = [exact("straight", *straight(2.0), true), exact("turn", *turned(10 * math.pi), true)]
    found = fit(runs, free=("scale", "track"), start=Factors(ratio=1.01))
    assert found.factors == pytest.approx(true, rel=1e-9)


def test_a_heading_that_was_not_measured_is_not_needed() -> None:
    runs = [
        Run(run.kind, run.left, run.right, TRACK_M, run.measured[:2], run.std[:2])
        for run in squares_and_straight()
    ]
    assert fit(runs).factors == pytest.approx(TRUE, rel=1e-6)


def test_a_heading_of_any_number_of_turns_is_the_same() -> None:
    runs = squares_and_straight()
    x, y, heading = runs[0].measured
    runs[0] = Run(
        "pose", runs[0].left, runs[0].right, TRACK_M, (x, y, heading - 4 * math.pi), runs[0].std
    )
    assert fit(runs).factors == pytest.approx(TRUE, rel=1e-7)


@pytest.mark.parametrize(
    ("runs", "free", "part"),
    [
        ([("straight", straight(5.0))], PARTS, "ratio|track"),
        ([("turn", turned(20.0))], ("scale", "track"), "scale|track"),
        ([("straight", straight(5.0))], ("scale", "track"), "track"),
    ],
)
def test_runs_that_do_not_show_a_factor_are_refused_by_its_name(runs, free, part) -> None:
    made = [exact(kind, *travel, Factors(1.03, 1.0, 0.95)) for kind, travel in runs]
    with pytest.raises(Unseen, match=part) as refused:
        fit(made, free=free)
    assert unseen(refused.value).startswith("These runs do not show")


def test_the_deviations_that_are_named_are_those_of_many_robots() -> None:
    rng = np.random.default_rng(5)
    off = []
    for _ in range(40):
        robot = SlippingRobot(rng, TRUE, SLIP_M_PER_SQRT_M)
        runs = [robot.measured(*square(SIDE_M, left=left)) for left in (True, False)]
        found = fit([*runs, robot.measured(*straight(STRAIGHT_M))])
        off.append((np.array(found.factors) / np.array(TRUE) - 1.0) / np.array(found.std))
    # 40 samples of a variance of 1: 0.5 to 1.7 holds it at 99.9 %.
    assert np.all((np.var(off, axis=0) > 0.5) & (np.var(off, axis=0) < 1.7)), np.var(off, axis=0)


def test_random_robots_are_found_as_well_as_slip_allows() -> None:
    rng = np.random.default_rng(3)
    slip = SLIP_M_PER_SQRT_M * math.sqrt(0.1)
    off, bounds = [], []
    for _ in range(12):
        true = Factors(
            scale=1.0 + rng.uniform(-0.05, 0.05),
            ratio=1.0 + rng.uniform(-0.02, 0.02),
            track=1.0 + rng.uniform(-0.10, 0.10),
        )
        robot = SlippingRobot(rng, true, slip)
        runs = [robot.measured(*square(SIDE_M, left=left)) for left in 5 * (True, False)]
        runs.append(robot.measured(*straight(STRAIGHT_M)))
        found = fit(runs, slip=slip).factors
        off.append(np.abs(np.array(found) / np.array(true) - 1.0))
        # If every step of the true path were known, slip alone would limit the ratio.
        driven = sum(float(np.abs(run.left).sum()) for run in runs)
        bounds.append(slip * math.sqrt(2.0 / driven))
    errors = dict(zip(Factors._fields, np.median(off, axis=0), strict=True))
    assert errors["track"] < 0.002
    assert errors["scale"] < 0.0012
    assert errors["ratio"] < 1.5 * np.median(bounds)
