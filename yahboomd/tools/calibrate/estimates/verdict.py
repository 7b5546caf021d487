"""Decides whether a calibration can be trusted; words for the reasons against it."""

from __future__ import annotations

from collections.abc import Sequence

from yahboomd.tools.calibrate.estimates.least_squares import Fit, Unseen
from yahboomd.tools.calibrate.estimates.runs import Run
from yahboomd.tools.calibrate.estimates.sideways import Sideways, SidewaysRun

STD_MAX = 0.01
"""Measure a factor with a larger deviation by tape instead."""

CHI_SQUARED_MAX = 6.0
"""The most by which a residual may exceed its expected square: floors differ in their slip."""

RADIUS = (0.8, 1.25)
TRACK = (0.8, 1.25)
SKID_STEER_TRACK = (0.8, 2.5)

SIDEWAYS = (0.6, 1.25)
"""The rollers of a sound base slip by 5 to 20 %, on carpet by more."""

SIDES_APART = 0.1
"""The largest difference between the ways to the left and to the right on one floor, as a share."""

LEAST_STRAIGHT_M = 1.0
LEAST_SIDEWAYS_M = 0.5
LEAST_TURN_RAD = 6.0
STRAIGHT_RAD = 1.0
"""A run that turned by less was driven straight."""

_OBSERVE = {
    "scale": "drive a straight run of known length, 2 m or longer; closed squares do not show it",
    "ratio": "drive squares in both directions, and measure the robot's end positions",
    "track": "turn in place several times, or drive squares in both directions",
    "sideways": "drive 1 m or more to each side, and measure how far it went",
}
_NAMES = {
    "scale": "the wheels' size",
    "ratio": "the ratio of the wheels",
    "track": "the track",
    "sideways": "the way to the side",
}


def unseen(error: Unseen) -> str:
    """The quantities that the runs do not show, and what to drive instead."""
    return f"These runs do not show {_NAMES[error.part]}: {_OBSERVE[error.part]}."


def doubts(
    fit: Fit, *, skid_steer: bool, runs: Sequence[Run] = (), track: float | None = None
) -> list[str]:
    """The reasons not to use the result, a sentence each; empty if it can be used.

    Args:
        skid_steer: Whether the sides slip in turns, which makes the effective track wider.
        track: The multiplier of the track to be written; None: the fit's.
    """
    found = []
    for run in runs:
        straight = run.kind != "turn" and abs(run.turned_rad) < STRAIGHT_RAD
        if straight and run.travel_m < LEAST_STRAIGHT_M:
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
            "The measurements contradict each other: their errors are "
            f"{fit.chi_squared**0.5:.1f} times as large as slip and tape explain. Was a number "
            "mistyped, the robot pushed, or a direction mixed up?"
        )
    factors = fit.factors
    for name, value, (least, most) in (
        ("The left wheels' radius", factors.left, RADIUS),
        ("The right wheels' radius", factors.right, RADIUS),
        ("The track", track or factors.track, SKID_STEER_TRACK if skid_steer else TRACK),
    ):
        if not least <= value <= most:
            found.append(
                f"{name} would be {value:.3f} times the configured one, which is outside "
                f"{least:g} to {most:g}: correct the configuration first."
            )
    return found


def sideways_doubts(found: Sideways, runs: Sequence[SidewaysRun]) -> list[str]:
    """The reasons not to use a way to the side, a sentence each."""
    wrong = [
        f"A run of {run.travel_m:.2f} m to the side is too short: drive {LEAST_SIDEWAYS_M:g} m or "
        "more, better 1 m."
        for run in runs
        if run.travel_m < LEAST_SIDEWAYS_M
    ]
    if found.std > STD_MAX:
        wrong.append(
            f"These runs show the way to the side within {found.std:.1%} only: "
            f"{_OBSERVE['sideways']}."
        )
    if found.apart > SIDES_APART:
        wrong.append(
            f"The ways to the two sides differ by {found.apart:.0%}: was a number mistyped? Else "
            "look at the rollers, and whether each wheel is mounted at its own corner."
        )
    least, most = SIDEWAYS
    if not least <= found.factor <= most:
        wrong.append(
            f"The base would go {found.factor:.3f} m to the side for each metre that its wheels "
            f"count, which is outside {least:g} to {most:g}: is each motor in chassis.motors at "
            "its own corner, and do the rollers form an X, seen from above?"
        )
    return wrong
