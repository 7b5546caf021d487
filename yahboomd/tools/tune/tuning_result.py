"""The outcome of a tuning, and what of it is better than what was before. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from yahboomd.core.protocol.settings import BoardSettings
from yahboomd.tools.tune.estimates.loop_model import LoopModel
from yahboomd.tools.tune.estimates.step_response import StepFigures
from yahboomd.tools.tune.estimates.suggestion import Suggestion

GAINS, DEAD_ZONE = "pid", "deadzone"
"""The fields of stored settings that are tuned."""

OVERSHOOT = 0.05
BETTER = 0.9
"""Gains that settle within this share of the time before are worth a write."""


class WheelTuning(msgspec.Struct, kw_only=True):
    """The findings on one wheel.

    Attributes:
        position: Of its motor, 1 to 4.
        turning_output: The output at which it begins to turn, forward and backward; None where the
            board drives no motor without regulation.
        before: The figures of its step with the gains that the board stored.
        after: With those that it stores now; None where none were stored.
        model: The motor as the loop sees it; None where no model explains the steps.
        unexplained: The share of the steps that the model leaves.
    """

    name: str
    position: int
    turning_output: tuple[int, int] | None = None
    before: StepFigures | None = None
    after: StepFigures | None = None
    model: LoopModel | None = None
    unexplained: float | None = None


class Result(msgspec.Struct, kw_only=True):
    """The outcome of a tuning.

    Attributes:
        speed_m_s: The step.
        stored_before: Gains and dead zone that the board stored.
        stored_now: Those that it stores now.
        suggested: Those that are suggested; empty where none are.
        expected: The suggestion with what the models say of it.
        writes: Values written to the board's flash.
        resets: Restarts of the board that these cost.
        traces: Before and after: for each wheel its speeds by tick, in m/s; for pictures.
    """

    port: str = ""
    dialect: str = ""
    firmware: str = ""
    volts: float | None = None
    speed_m_s: float = 0.0
    stored_before: BoardSettings = msgspec.field(default_factory=dict)
    stored_now: BoardSettings = msgspec.field(default_factory=dict)
    suggested: BoardSettings = msgspec.field(default_factory=dict)
    expected: Suggestion | None = None
    wheels: list[WheelTuning] = msgspec.field(default_factory=list)
    writes: int = 0
    resets: int = 0
    notes: list[str] = msgspec.field(default_factory=list)
    traces: dict[str, list[list[float]]] = msgspec.field(default_factory=dict)

    @property
    def worth_writing(self) -> bool:
        """Whether the suggestion would be an improvement."""
        if not self.suggested:
            return False
        overshoot, settling_s = _worst([wheel.before for wheel in self.wheels])
        expected = self.expected
        if overshoot > OVERSHOOT or settling_s is None or expected is None:
            return True
        return expected.settling_s is not None and expected.settling_s < BETTER * settling_s


def _worst(found: Sequence[StepFigures | None]) -> tuple[float, float | None]:
    """The largest overshoot and the longest settling; None where one does not settle."""
    known = [each for each in found if each is not None]
    settled = [each.settling_s for each in known]
    longest = None if None in settled else max(each for each in settled if each is not None)
    return max(each.overshoot for each in known), longest


def rank_of(found: Sequence[StepFigures | None], *, trial: bool) -> tuple[bool, bool, float]:
    """Less is better: whether it overshoots or never settles, then trial gains, then its time.

    Trial gains are there to show the motors: suggested ones come before them.
    """
    overshoot, settling_s = _worst(found)
    bad = overshoot > OVERSHOOT or settling_s is None
    return bad, trial, math.inf if settling_s is None else settling_s


def tuned_of(settings: BoardSettings) -> BoardSettings:
    """Those of the settings that are tuned."""
    return {field: settings[field] for field in (GAINS, DEAD_ZONE) if field in settings}
