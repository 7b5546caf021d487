"""A small picture of the robot, seen from above, with a number at each driven wheel. Pure."""

from __future__ import annotations

from yahboomd.core.model import Kinematics

CORNERS = ("front_left", "front_right", "rear_left", "rear_right")
"""The wheels of a robot with four of them, in reading order: their numbers are 1 to 4."""

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


def wheels_of(geometry: Kinematics) -> tuple[str, ...]:
    """The driven wheels, in the order of their numbers in the picture; each side has two."""
    if geometry.sides or set(geometry.wheels) == set(CORNERS):
        return CORNERS
    return geometry.wheels


def picture(geometry: Kinematics) -> str:
    """The robot from above, or a list of the wheels if there is no picture of such a robot."""
    wheels = wheels_of(geometry)
    if wheels == CORNERS:
        return _FOUR
    if wheels == ("left", "right"):
        return _REAR if geometry.least_radius_m else _TWO
    return "\n".join(f"     [{number}] {name}" for number, name in enumerate(wheels, start=1))
