"""A small picture of the robot, seen from above, with a number at each driven wheel. Pure."""

from __future__ import annotations

from collections.abc import Sequence

CORNERS = ("front_left", "front_right", "rear_left", "rear_right")
"""The wheels of a robot with four of them, as one reads: their numbers are 1 to 4."""

_FOUR = """\
            front
     [1] ┌─────────┐ [2]
         │    ▲    │
         │         │
     [3] └─────────┘ [4]"""

_TWO = """\
            front
         ┌─────────┐
         │    ▲    │
     [1] │         │ [2]
         └─────────┘"""

_REAR = """\
            front
     ( ) ┌─────────┐ ( )
         │    ▲    │
         │         │
     [1] └─────────┘ [2]"""


def wheels_of(kinematics: str, wheels: Sequence[str]) -> tuple[str, ...]:
    """The driven wheels, in the order of their numbers in the picture.

    Args:
        wheels: Its wheels; a side of a skid-steer base has two.
    """
    return CORNERS if kinematics == "skid_steer" or len(wheels) == 4 else tuple(wheels)


def picture(kinematics: str, wheels: Sequence[str]) -> str:
    """The robot from above.

    Args:
        wheels: As :func:`wheels_of` gives them.
    """
    if len(wheels) == len(CORNERS):
        return _FOUR
    return _REAR if kinematics == "ackermann" else _TWO
