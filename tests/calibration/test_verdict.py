"""Results that must not be used, and those that may."""

from __future__ import annotations

import math

from calibration_runs import exact, squares_and_straight

from benchmarks.random_robots import TRACK_M, straight, turned
from yahboomd.calibration.least_squares import fit
from yahboomd.calibration.runs import Factors, Run
from yahboomd.calibration.verdict import doubts


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
