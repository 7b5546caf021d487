"""What makes gains better than others, and worth a write."""

from __future__ import annotations

import pytest

from yahboomd.tools.tune.estimates.loop_model import Gains
from yahboomd.tools.tune.estimates.step_response import StepFigures
from yahboomd.tools.tune.estimates.suggestion import Suggestion
from yahboomd.tools.tune.tuning_result import Result, WheelTuning, rank_of, tuned_of


def figures(settling_s: float | None, overshoot: float = 0.0) -> StepFigures:
    return StepFigures(rise_s=0.1, overshoot=overshoot, settling_s=settling_s, steady_error=0.0)


def test_gains_that_settle_come_first_and_suggested_ones_before_trial_ones() -> None:
    fast, slow = [figures(0.2), figures(0.1)], [figures(0.3), figures(0.1)]
    worse = [figures(0.1), figures(0.1, overshoot=0.06)]
    never = [figures(0.1), figures(None)]
    ranks = [
        rank_of(fast, trial=False),
        rank_of(slow, trial=False),
        rank_of(fast, trial=True),
        rank_of(worse, trial=False),
        rank_of(never, trial=False),
    ]
    assert ranks == sorted(ranks)
    assert [bad for bad, *_ in ranks] == [False, False, False, True, True]


@pytest.mark.parametrize(
    ("before", "expected_s", "worth"),
    [
        (figures(0.5), 0.4, True),
        (figures(0.5), 0.46, False),
        (figures(0.5), None, False),
        (figures(0.5, overshoot=0.06), 0.6, True),
        (figures(None), 0.6, True),
    ],
)
def test_a_suggestion_is_worth_a_write_where_it_settles_a_tenth_sooner_or_the_board_is_bad(
    before: StepFigures, expected_s: float | None, worth: bool
) -> None:
    result = Result(
        suggested={"pid": (1.0, 0.1, 0.0)},
        expected=Suggestion(
            gains=Gains(1.0, 0.1, 0.0), lambda_s=0.1, overshoot=0.0, settling_s=expected_s
        ),
        wheels=[WheelTuning(name="left", position=1, before=before)],
    )
    assert result.worth_writing is worth
    result.suggested = {}
    assert not result.worth_writing


def test_only_gains_and_dead_zone_are_tuned() -> None:
    assert tuned_of({"pid": (1.0, 0.1, 0.0), "lines": 11}) == {"pid": (1.0, 0.1, 0.0)}
