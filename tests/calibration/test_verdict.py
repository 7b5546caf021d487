"""Results that must not be used, and those that may."""

from __future__ import annotations

import math

import numpy as np
import pytest
from calibration_runs import TRACK_M, exact, squares_and_straight, straight, turned

from yahboomd.tools.calibrate.estimates.least_squares import fit
from yahboomd.tools.calibrate.estimates.runs import Factors, Run
from yahboomd.tools.calibrate.estimates.sideways import Sideways, SidewaysRun
from yahboomd.tools.calibrate.estimates.verdict import doubts, sideways_doubts


def test_a_mistyped_measurement_is_noticed() -> None:
    runs = squares_and_straight()
    x, y, heading = runs[1].measured
    runs[1] = Run("pose", runs[1].left, runs[1].right, TRACK_M, (x + 1.0, y, heading), runs[1].std)
    (words,) = doubts(fit(runs), skid_steer=False, runs=runs)
    assert "contradict each other" in words


def test_a_good_result_has_no_doubts() -> None:
    runs = squares_and_straight() * 5
    assert doubts(fit(runs), skid_steer=False, runs=runs) == []


def test_a_track_far_off_is_refused_and_not_on_skid_steer() -> None:
    wide = Factors(track=1.6)
    runs = [exact("straight", *straight(5.0), wide), exact("turn", *turned(30 * math.pi), wide)]
    found = fit(runs, free=("scale", "track"))
    (words,) = doubts(found, skid_steer=False, runs=runs)
    assert words.startswith("The track would be 1.600 times the configured one")
    assert doubts(found, skid_steer=True, runs=runs) == []


def test_too_short_a_run_is_refused_with_what_to_drive() -> None:
    runs = [exact("straight", *straight(0.5)), exact("turn", *turned(3.0))]
    words = " ".join(doubts(fit(runs, free=("scale", "track")), skid_steer=False, runs=runs))
    assert "drive 1 m or more" in words
    assert "turn once around or more" in words


def test_a_track_is_judged_by_what_would_be_written() -> None:
    runs = [exact("straight", *straight(5.0)), exact("turn", *turned(30 * math.pi))]
    found = fit(runs, free=("scale", "track"))
    assert doubts(found, skid_steer=False, runs=runs, track=1.2) == []
    (words,) = doubts(found, skid_steer=False, runs=runs, track=1.4)
    assert words.startswith("The track would be 1.400 times")


def beside(metres: float) -> SidewaysRun:
    steps = np.full(10, metres / 10.0)
    return SidewaysRun(0.0 * steps, steps, 0.0 * steps, metres, 0.002)


@pytest.mark.parametrize(
    ("found", "metres", "words"),
    [
        (Sideways(0.9, 0.002, 0.01), 1.0, ""),
        (Sideways(0.9, 0.002, 0.01), 0.4, "drive 0.5 m or more"),
        (Sideways(0.9, 0.02, 0.01), 1.0, "within 2.0% only: drive 1 m or more to each side"),
        (Sideways(0.9, 0.002, 0.12), 1.0, "differ by 12%"),
        (Sideways(0.59, 0.002, 0.01), 1.0, "outside 0.6 to 1.25"),
        (Sideways(1.26, 0.002, 0.01), 1.0, "go 1.260 m to the side"),
    ],
)
def test_a_way_to_the_side_that_cannot_be_trusted_is_refused_with_its_reason(
    found: Sideways, metres: float, words: str
) -> None:
    doubts_of_it = sideways_doubts(found, [beside(metres)])
    assert len(doubts_of_it) == bool(words)
    assert words in "".join(doubts_of_it)
