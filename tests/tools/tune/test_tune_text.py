"""The outcome of a tuning in lines."""

from __future__ import annotations

from yahboomd.tools.tune.estimates.step_response import StepFigures
from yahboomd.tools.tune.tune_text import lines
from yahboomd.tools.tune.tuning_result import Result, WheelTuning

SOON = StepFigures(rise_s=0.05, overshoot=0.012, settling_s=0.08, steady_error=-0.001)
NEVER = StepFigures(rise_s=None, overshoot=0.0, settling_s=None, steady_error=-0.6)


def test_it_has_both_steps_of_each_wheel_and_every_write():
    result = Result(
        speed_m_s=0.4,
        stored_before={"pid": (0.1, 0.01, 0.0), "deadzone": 0},
        stored_now={"pid": (0.7, 0.12, 0.0), "deadzone": 1900},
        suggested={"pid": (0.7, 0.12, 0.0), "deadzone": 1900},
        wheels=[
            WheelTuning(
                name="left",
                position=1,
                turning_output=(2000, 1990),
                stopping_output=(1510, 1500),
                before=NEVER,
                after=SOON,
            )
        ],
        writes=2,
        resets=1,
        notes=["A note."],
    )
    text = "\n".join(lines(result))
    assert "left (M1)   before   never    0.0%        no        -60.0%         2000 / -1990" in text
    assert "1510 / -1500" in text
    assert "after    0.05 s   1.2%        0.08 s    -0.1%" in text
    assert "stored before   P 0.1, I 0.01, D 0; dead zone 0" in text
    assert "stored now      P 0.7, I 0.12, D 0; dead zone 1900" in text
    assert "2 values, 1 restarts" in text
    assert "  - A note." in text
