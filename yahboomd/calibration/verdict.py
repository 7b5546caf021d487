"""Whether a calibration can be trusted, and why not in words."""

from __future__ import annotations

from collections.abc import Sequence

from yahboomd.calibration.least_squares import Fit, Unseen
from yahboomd.calibration.runs import Run

STD_MAX = 0.01
"""A factor that is known worse than this is better measured with a tape."""

CHI_SQUARED_MAX = 6.0
"""The most by which a residual may exceed its expected square: floors differ in their slip."""

RADIUS = (0.8, 1.25)
TRACK = (0.8, 1.25)
SKID_STEER_TRACK = (0.8, 2.5)

LEAST_STRAIGHT_M = 1.0
LEAST_TURN_RAD = 6.0

_OBSERVE = {
    "scale": "drive a straight run of known length, 2 m or longer; closed squares do not show it",
    "ratio": "drive squares in both directions, and measure where the robot ends",
    "track": "turn in place several times, or drive squares in both directions",
    "travel": "record for a minute or longer, with curves to both sides",
}
_NAMES = {
    "scale": "the wheels' size",
    "ratio": "the ratio of the wheels",
    "track": "the track",
    "travel": "travel",
}


def unseen(error: Unseen) -> str:
    """The quantities that the runs do not show, and what to drive instead."""
    return f"These runs do not show {_NAMES[error.part]}: {_OBSERVE[error.part]}."


def doubts(fit: Fit, *, skid_steer: bool, runs: Sequence[Run] = ()) -> list[str]:
    """The reasons not to use the result, a sentence each; empty where it can be used.

    Args:
        fit: The result.
        skid_steer: Whether the sides slip in turns, which makes the effective track wider.
        runs: What it was fitted to.
    """
    found = []
    for run in runs:
        if run.kind == "straight" and run.travel_m < LEAST_STRAIGHT_M:
            found.append(
                f"A straight run of {run.travel_m:.2f} m is too short: drive "
                f"{LEAST_STRAIGHT_M:g} m or more, better 5 m."
            )
        if run.kind == "turn" and abs(run.turned_rad) < LEAST_TURN_RAD:
            found.append(
                f"A turn of {abs(run.turned_rad):.1f} rad is too small: turn once around or more, "
                "better five times."
            )
    for part, std in zip(fit.std._fields, fit.std, strict=True):
        if std > STD_MAX:
            found.append(
                f"These runs show {_NAMES[part]} within {std:.1%} only: {_OBSERVE[part]}, more "
                "often or longer."
            )
    if fit.chi_squared > CHI_SQUARED_MAX:
        found.append(
            f"The measurements contradict each other: what is left over is "
            f"{fit.chi_squared**0.5:.1f} times what slip and tape explain. Was a number mistyped, "
            "a run pushed by hand, or a direction mixed up?"
        )
    factors = fit.factors
    for name, value, (least, most) in (
        ("The left wheels' radius", factors.left, RADIUS),
        ("The right wheels' radius", factors.right, RADIUS),
        ("The track", factors.track, SKID_STEER_TRACK if skid_steer else TRACK),
    ):
        if not least <= value <= most:
            found.append(
                f"{name} would be {value:.3f} times the configured one, which is outside "
                f"{least:g} to {most:g}: correct the configuration first."
            )
    return found
