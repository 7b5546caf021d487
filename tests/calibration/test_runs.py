"""The path by the counts: exact arcs, whatever the factors."""

from __future__ import annotations

import math

import numpy as np
import pytest

from yahboomd.tools.calibrate.estimates.runs import Factors, Run, path


def run(left: list[float], right: list[float]) -> Run:
    return Run("pose", np.array(left), np.array(right), 0.2, (), ())


def test_a_half_circle_in_one_step_ends_a_diameter_to_the_left() -> None:
    # Radius 0.5 m of the middle, so 0.4 m inside and 0.6 m outside.
    found = path(run([0.4 * math.pi], [0.6 * math.pi]), Factors())
    assert (found.x[-1], found.y[-1]) == pytest.approx((0.0, 1.0))
    assert found.heading[-1] == pytest.approx(math.pi)


def test_a_larger_ratio_bends_a_straight_to_the_left_and_keeps_its_length() -> None:
    straight = run([0.1] * 10, [0.1] * 10)
    bent = path(straight, Factors(ratio=1.02))
    assert bent.heading[-1] > 0.0
    assert bent.y[-1] > 0.0
    factors = Factors(scale=1.1, ratio=1.02)
    assert (factors.left + factors.right) / 2.0 == pytest.approx(1.1)
    assert factors.right / factors.left == pytest.approx(1.02)


def test_a_wider_track_turns_less() -> None:
    turn = run([-0.1], [0.1])
    assert path(turn, Factors(track=1.25)).heading[-1] == pytest.approx(turn.turned_rad / 1.25)


def test_travel_counts_forward_and_back() -> None:
    assert run([0.3, -0.2], [0.3, -0.2]).travel_m == pytest.approx(0.5)
