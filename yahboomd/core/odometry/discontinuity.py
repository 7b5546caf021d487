"""Breaks in the counts: the travel that they lose, and the events that report them.

:mod:`~yahboomd.core.odometry.encoders` decides which reading ends one; the pose continues from its
last value.
"""

from __future__ import annotations

from yahboomd.core.model import Event
from yahboomd.core.odometry.encoders import Outcome
from yahboomd.core.odometry.tick_meter import Notice

RESET_SPEED_M_S = 0.1
"""The speed that a wheel may have gained since its last measurement when the board resets."""

COUNTERS: dict[Outcome, str] = {
    "reset": "odometry_resets",
    "reset_unseen": "odometry_resets",
    "gap_kept": "odometry_gaps",
    "gap_lost": "odometry_gaps",
    "rebased": "odometry_rebased",
}
"""The odometer's counter for each outcome."""


def unknown_m(outcome: Outcome, gap_s: float, *, fastest_m_s: float, speed_max_m_s: float) -> float:
    """The travel that a wheel may have made without being counted; metres.

    Args:
        outcome: The kind of break.
        gap_s: From the last reading before it to the first after it.
        fastest_m_s: Rim speed of the fastest wheel, as last seen.
        speed_max_m_s: A rim speed that no wheel reaches.
    """
    if outcome == "gap_kept":
        return 0.0
    if outcome == "reset":
        # A reset releases the motors: no wheel rolled faster before it than last seen.
        return min(speed_max_m_s, fastest_m_s + RESET_SPEED_M_S) * gap_s
    return speed_max_m_s * gap_s


def event(
    outcome: Outcome, *, gap_s: float, lost_m: float, counted_m: float, unsure_m: float
) -> Event:
    """The event of a break: a warning if travel was lost, else for information.

    Args:
        lost_m: The most of each wheel's travel that may be unknown.
        counted_m: The largest travel of a wheel that was counted across the break.
        unsure_m: How far the base may be from the pose, because the order in which it went and
            turned is unknown.
    """
    happened, done = _WORDS[outcome]
    lost = "" if not lost_m else f" Up to {lost_m:.2f} m of each wheel's travel are unknown."
    return Event(
        kind="odometry_discontinuity" if lost_m else "odometry_bridged",
        severity="warning" if lost_m else "info",
        message=f"{happened} {done}{lost}",
        data={
            "cause": outcome,
            "gap_s": round(gap_s, 6),
            "unknown_m": round(lost_m, 6),
            "counted_m": round(counted_m, 6),
            "unsure_m": round(unsure_m, 6),
        },
    )


def clock_event(notice: Notice, period_ms: float) -> Event:
    """The event about a board whose tick has another period, or none.

    Args:
        period_ms: The period that yahboomd uses from now on.
    """
    if notice == "period":
        return Event(
            kind="board_clock_period",
            severity="info",
            message=f"The board renews its counts every {period_ms:g} ms. yahboomd stamps poses by "
            "this tick from now on; nothing needs to be done.",
            data={"period_ms": period_ms},
        )
    return Event(
        kind="board_clock_unfit",
        severity="warning",
        message="The board's counts follow no regular tick. yahboomd stamps poses by the arrival "
        "of its lines instead, and takes speeds over a longer time. Firmware 1.7.3 has a tick of "
        "10 ms; `yahboomd probe` shows the board's version.",
        data={"period_ms": None},
    )


_WORDS: dict[Outcome, tuple[str, str]] = {
    "reset": (
        "The board reset itself and counts from zero.",
        "The pose continues from its last value, with the counts since.",
    ),
    "reset_unseen": (
        "The counters fell to near zero: the board must have reset itself.",
        "The pose continues from its last value, with the counts since.",
    ),
    "gap_kept": (
        "Counts were missing for a while, and the board went on counting.",
        "The pose includes what it counted.",
    ),
    "gap_lost": (
        "Counts were missing for a while, and the board may have been reset meanwhile.",
        "The pose holds; set it again if the robot was moved.",
    ),
    "rebased": (
        "The counters jumped farther than the wheels can roll, and stayed there.",
        "The pose holds and counting goes on from there.",
    ),
}
"""For each outcome: the event, and the reaction of yahboomd."""
