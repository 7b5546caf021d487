"""The outcome of a tuning, and whether it is better than the state before. Pure."""

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
"""Gains must settle within this share of the old settling time to be worth a write."""

ALIKE, ALIKE_S, ALIKE_OVERSHOOT = 1.1, 0.02, 0.02
"""Repeated steps differ by this in their settling time and overshoot."""


class WheelTuning(msgspec.Struct, kw_only=True):
    """The findings on one wheel.

    Attributes:
        position: The plug of its motor, 1 to 4.
        turning_output: The output at which it begins to turn, forward and backward; None if the
            board cannot drive a motor without regulation.
        stopping_output: The output at which the turning wheel stops, likewise; None if the board
            stores no dead zone.
        before: The figures of its step with the gains from before.
        after: The figures with the newly stored gains; None if none were stored.
        model: The fitted motor; None without a fit.
        unexplained: The share of the steps that the model does not explain.
    """

    name: str
    position: int
    turning_output: tuple[int, int] | None = None
    stopping_output: tuple[int, int] | None = None
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
        suggested: The suggested ones; empty if there are none.
        expected: The suggestion with its predicted behaviour.
        writes: Values written to the board's flash.
        resets: Restarts of the board for these writes.
        traces: The speeds of each wheel by tick, in m/s, before and after; for pictures.
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
        overshoot, settling_s = worst([wheel.before for wheel in self.wheels])
        expected = self.expected
        if overshoot > OVERSHOOT or settling_s is None or expected is None:
            return True
        return expected.settling_s is not None and expected.settling_s < BETTER * settling_s


def worst(found: Sequence[StepFigures | None]) -> tuple[float, float | None]:
    """The largest overshoot and the longest settling; None if one does not settle."""
    known = [each for each in found if each is not None]
    settled = [each.settling_s for each in known]
    longest = None if None in settled else max(each for each in settled if each is not None)
    return max(each.overshoot for each in known), longest


def rank_of(found: Sequence[StepFigures | None], *, trial: bool) -> tuple[bool, bool, float]:
    """A sort key, the best first: no overshoot and settled, then not trial gains, then the time.

    Trial gains only serve to measure the motors, so suggested ones rank before them.
    """
    overshoot, settling_s = worst(found)
    bad = overshoot > OVERSHOOT or settling_s is None
    return bad, trial, math.inf if settling_s is None else settling_s


def no_worse(after: Sequence[StepFigures | None], before: Sequence[StepFigures | None]) -> bool:
    """Whether wheels follow as well as before, as far as steps that are repeated are alike."""
    overshoot, settling_s = worst(after)
    overshot, settled_s = worst(before)
    if overshoot > max(OVERSHOOT, overshot + ALIKE_OVERSHOOT):
        return False
    return settled_s is None or (
        settling_s is not None and settling_s <= ALIKE * settled_s + ALIKE_S
    )


def tuned_of(settings: BoardSettings) -> BoardSettings:
    """The settings that a tuning changes."""
    return {field: settings[field] for field in (GAINS, DEAD_ZONE) if field in settings}
