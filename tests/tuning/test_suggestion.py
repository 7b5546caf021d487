"""Suggested gains: Skogestad's formula, and the λ that every fitted motor bears."""

from __future__ import annotations

from itertools import pairwise

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.tools.tune.estimates.loop_model import LoopModel, run
from yahboomd.tools.tune.estimates.suggestion import LAMBDAS, OFF, formula, suggest

TICK_S = 0.01
MOTOR = LoopModel(gain=2.8, lag_s=0.06, gap=20.0, fastest=1150.0)


def overshoot(model, gains):
    travel = run(model, gains, 400.0, tick_s=TICK_S, ticks=150)
    return max(after - before for before, after in pairwise(travel)) / TICK_S / 400.0 - 1.0


def test_the_formula_is_skogestads():
    gains = formula(MOTOR, 0.03, TICK_S)
    assert gains.p == pytest.approx(0.06 / (2.8 * 0.04), abs=0.001)
    # The integral time is the lag, as long as that is less than four horizons.
    assert gains.i == pytest.approx(gains.p * TICK_S / 0.06, abs=0.001)
    assert gains.d == 0.0


def test_the_integral_time_of_a_slow_motor_is_four_horizons():
    slow = msgspec.structs.replace(MOTOR, lag_s=1.0)
    gains = formula(slow, 0.03, TICK_S)
    assert gains.i == pytest.approx(gains.p * TICK_S / (4.0 * 0.04), abs=0.001)


@given(
    st.floats(0.5, 8.0),
    st.floats(0.03, 0.3),
    st.floats(0.0, 40.0),
)
def test_a_motor_that_is_off_by_a_quarter_still_overshoots_little(gain, lag_s, gap):
    model = LoopModel(gain=gain, lag_s=lag_s, gap=gap, fastest=1150.0)
    found = suggest([model], 400.0, tick_s=TICK_S, count=0.16)
    assert found.overshoot <= 0.03
    assert found.settling_s is not None
    off = msgspec.structs.replace(model, gain=gain * OFF, lag_s=lag_s / OFF)
    assert overshoot(off, found.gains) < 0.12


def test_with_coarse_counts_a_motor_that_is_off_by_a_quarter_overshoots_by_6_percent_at_most():
    model = msgspec.structs.replace(MOTOR, gain=6.6, lag_s=0.1)
    gains = suggest([model], 200.0, tick_s=TICK_S, count=0.5).gains
    off = msgspec.structs.replace(model, gain=model.gain * OFF, lag_s=model.lag_s / OFF)
    travel = run(off, gains, 200.0, tick_s=TICK_S, ticks=150, count=0.5)
    assert max(after - before for before, after in pairwise(travel)) <= 1.06 * 200.0 * TICK_S


def test_one_set_of_gains_is_for_all_motors():
    others = [
        MOTOR,
        msgspec.structs.replace(MOTOR, gain=4.0),
        msgspec.structs.replace(MOTOR, lag_s=0.1),
    ]
    found = suggest(others, 400.0, tick_s=TICK_S, count=0.16)
    assert max(overshoot(each, found.gains) for each in others) <= 0.035
    assert found.settling_s is not None


def test_one_that_was_too_fast_is_followed_by_a_slower_one():
    first = suggest([MOTOR], 400.0, tick_s=TICK_S, count=0.16)
    second = suggest([MOTOR], 400.0, tick_s=TICK_S, count=0.16, least_lambda_s=1.5 * first.lambda_s)
    assert second.lambda_s >= 1.5 * first.lambda_s
    assert second.gains.p < first.gains.p


def test_where_none_is_allowed_the_least_bad_one_is_suggested():
    coarse = suggest([MOTOR], 30.0, tick_s=TICK_S, count=4.0)
    assert coarse.lambda_s in LAMBDAS
    assert coarse.overshoot > 0.03


def test_a_motor_that_needs_all_of_the_second_and_a_half_has_not_settled():
    """It is in the band from 1.48 s on: too late to have been seen to stay."""
    slow = msgspec.structs.replace(MOTOR, lag_s=0.5, gap=200.0)
    assert suggest([slow], 400.0, tick_s=TICK_S, count=0.16, least_lambda_s=0.3).settling_s is None
