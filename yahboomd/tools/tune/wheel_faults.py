"""Detects misbehaving wheels in the air, from the counts since their command. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence

from yahboomd.core.errors import BoardError
from yahboomd.core.model import Counts, Motor

AGAINST_M = 0.02
TOO_FAST = 1.7
TOO_FAST_M_S = 0.15
SLACK_S = 0.05

MOVES_WITHIN_S = 1.2
"""The time to the first motion, unless a ramp has shown before that the wheel turns and counts."""

STANDS_COUNTS = 2
STANDS_WHILE_S = 0.3
"""A wheel that stands is at fault once another one has moved as far as it should in this time."""

TOUCHED_COUNTS = 12
"""A wheel that turns this far while another one is driven touches the ground, or is coupled."""


class WheelFault(BoardError):
    """A wheel does not do as it is commanded, unless the line damaged a command."""


def found(
    motors: Sequence[Motor],
    expected: Sequence[float],
    counted: Counts,
    waited_s: float,
    *,
    ramped: bool,
    may_stand: bool = False,
) -> str:
    """Describe the first wheel that does not follow, in a sentence; empty if all follow.

    Late readings make a wheel look slower, never faster.

    Args:
        expected: The commanded speed of each motor, m/s.
        ramped: Whether a ramp has shown before that every wheel turns and counts.
        may_stand: Whether the stored dead zone may be too small to start every wheel.
    """
    farthest_m = max(abs(counted[each.position - 1]) * each.metres_per_tick for each in motors)
    for motor, wanted in zip(motors, expected, strict=True):
        counts = counted[motor.position - 1] * motor.encoder_sign
        along_m = math.copysign(counts * motor.metres_per_tick, counts * wanted)
        if along_m < -AGAINST_M:
            what = "turned against its command"
            look = "Its signs, or the wires of its encoder, are wrong."
        elif along_m > (TOO_FAST * abs(wanted) + TOO_FAST_M_S) * (waited_s + SLACK_S):
            what = f"ran at {along_m / waited_s:.2f} m/s instead of {abs(wanted):.2f} m/s"
            look = "Look at its encoder's cable and at the stored settings."
        elif may_stand and abs(counts) <= STANDS_COUNTS:
            continue
        elif abs(counts) <= STANDS_COUNTS and farthest_m > STANDS_WHILE_S * abs(wanted):
            what = "stood while another wheel turned"
            look = (
                "It turned alone before: its cable is loose, it is held, or the stored gains and "
                "dead zone are too small to start it."
                if ramped
                else "Its encoder or its motor is not connected, or it is held."
            )
        elif counts == 0 and waited_s > MOVES_WITHIN_S and not ramped:
            what = f"did not turn within {MOVES_WITHIN_S:g} s"
            look = "Its encoder or its motor is not connected, or the stored gains are too small."
        else:
            continue
        return f"{motor.name} (M{motor.position}) {what}; the motors were cut. {look}"
    return ""


def check_alone(motor: Motor, motors: Sequence[Motor], counts: Counts) -> None:
    """Check that no other wheel turned with the driven one.

    Raises:
        WheelFault: One did.
    """
    for other in motors:
        if other is not motor and abs(counts[other.position - 1]) > TOUCHED_COUNTS:
            raise WheelFault(
                f"{other.name} (M{other.position}) turned while {motor.name} alone was driven: "
                "they touch the ground, are coupled, or the plugs of encoders are swapped.",
                remedy="Put the robot on a stand so that every wheel turns freely.",
            )
