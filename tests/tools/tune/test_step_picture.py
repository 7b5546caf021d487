"""The picture of a tuning has every wheel, both steps, and their figures."""

from __future__ import annotations

from pathlib import Path

import pytest

from yahboomd.core.errors import Refused
from yahboomd.tools.tune.estimates.step_response import StepFigures
from yahboomd.tools.tune.step_picture import draw, save_picture, summary
from yahboomd.tools.tune.tuning_result import Result, WheelTuning

# The library is imported once, by one worker.
pytestmark = pytest.mark.xdist_group("pictures")

SOON = StepFigures(rise_s=0.05, overshoot=0.012, settling_s=0.08, steady_error=-0.001)
NEVER = StepFigures(rise_s=None, overshoot=0.0, settling_s=None, steady_error=-0.6)


def result(wheels: int) -> Result:
    return Result(
        speed_m_s=0.4,
        wheels=[
            WheelTuning(name=f"wheel{number}", position=number, before=NEVER, after=SOON)
            for number in range(1, wheels + 1)
        ],
        traces={"before": [[0.1] * 150] * wheels, "after": [[0.4] * 150] * wheels},
    )


@pytest.mark.cases(1)
@pytest.mark.parametrize("wheels", [1, 2, 3, 4])
def test_each_wheel_has_its_axes_with_both_steps(wheels):
    drawn = [axes for axes in draw(result(wheels)).axes if axes.axison]
    assert [axes.get_title() for axes in drawn] == [
        f"wheel{number} (M{number})" for number in range(1, wheels + 1)
    ]
    for axes in drawn:
        words = [text.get_text() for text in axes.get_legend().get_texts()]
        assert words == [f"before: {summary(NEVER)}", f"after: {summary(SOON)}"]


def test_a_picture_that_cannot_be_written_is_named():
    with pytest.raises(Refused, match="cannot be written"):
        save_picture(result(1), Path("/proc/a.png"))
