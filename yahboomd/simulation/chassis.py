"""The true pose of the robot: travel of the rims, integrated in fine steps with exact arcs.

Every wheel moves the body by a fixed share of its rim travel (the forward kinematics, one row per
motor), so that all drives integrate by the same formula.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeAlias, assert_never

from yahboomd.core.model import Pose2d, Twist2d
from yahboomd.simulation.options import DriveName, Wiring

Share: TypeAlias = tuple[float, float, float]
"""Motion of the body by one metre of a wheel's rim: metres ahead, metres to the left, radians."""

_MECANUM: dict[str, tuple[int, int]] = {
    "front_left": (-1, -1),
    "rear_left": (1, -1),
    "front_right": (1, 1),
    "rear_right": (-1, 1),
}
"""Signs of a wheel's share in the sideways motion and in the turn, rollers in an X."""


def shares(
    drive: DriveName,
    motors: tuple[Wiring, ...],
    *,
    wheel_separation_m: float,
    wheel_base_m: float,
    sideways: float = 1.0,
) -> tuple[Share, ...]:
    """The share of each motor, in the order of the motors.

    A side with several wheels moves as their mean; so do the rear wheels of a car whose board turns
    no steering. Mecanum is the least-squares inverse of
    v = vx -+ vy -+ (half base + half track) wz, with the slip of its rollers to the side. Rollers
    that are mounted mirrored push on the base along lines through its middle: nothing turns it.
    """
    match drive:
        case "mecanum":
            arm_m = (wheel_separation_m + wheel_base_m) / 2.0
            return tuple(
                (
                    0.25,
                    0.25 * sideways * _MECANUM[wire.corner][0],
                    0.25 * _MECANUM[wire.corner][1] / arm_m if sideways > 0.0 else 0.0,
                )
                for wire in motors
            )
        case "differential" | "skid_steer" | "ackermann":
            return _sides(motors, wheel_separation_m)
        case _:
            assert_never(drive)


def _sides(motors: tuple[Wiring, ...], wheel_separation_m: float) -> tuple[Share, ...]:
    on_left = ["left" in wire.corner for wire in motors]
    count = {True: sum(on_left), False: len(motors) - sum(on_left)}
    return tuple(
        (
            0.5 / count[left],
            0.0,
            (-1.0 if left else 1.0) / (wheel_separation_m * count[left]),
        )
        for left in on_left
    )


class ChassisTruth:
    """The pose of the base, moved by the rims.

    Attributes:
        turn_per_m: Radians for each metre ahead, as steered front wheels impose it regardless of
            the rear wheels' difference; None if only the rims turn the base.
    """

    def __init__(self, parts: tuple[Share, ...]) -> None:
        self._parts = parts
        self.turn_per_m: float | None = None
        self._x = 0.0
        self._y = 0.0
        self._theta = 0.0

    @property
    def pose(self) -> Pose2d:
        """Metres, metres, radians (not wrapped)."""
        return Pose2d(x=self._x, y=self._y, theta=self._theta)

    def body(self, rims: Sequence[float]) -> Share:
        """The body's motion for these rim motions (travel or speed), one per motor."""
        ahead = left = turn = 0.0
        for rim, (part_ahead, part_left, part_turn) in zip(rims, self._parts, strict=True):
            ahead += rim * part_ahead
            left += rim * part_left
            turn += rim * part_turn
        if self.turn_per_m is not None:
            turn = ahead * self.turn_per_m
        return ahead, left, turn

    def twist(self, speeds_m_s: Sequence[float]) -> Twist2d:
        """The body's velocity for these rim speeds."""
        vx, vy, wz = self.body(speeds_m_s)
        return Twist2d(vx=vx, vy=vy, wz=wz)

    def advance(self, travels_m: Sequence[float]) -> None:
        """Move by one fine step.

        A constant twist moves along R(theta + turn/2) (ahead, left) sinc(turn/2), exactly.
        """
        ahead, left, turn = self.body(travels_m)
        half = turn / 2.0
        # sin(h)/h and its series agree to the last bit below this bound.
        chord = math.sin(half) / half if abs(half) > 1e-4 else 1.0 - half * half / 6.0
        cosine, sine = math.cos(self._theta + half), math.sin(self._theta + half)
        self._x += chord * (cosine * ahead - sine * left)
        self._y += chord * (sine * ahead + cosine * left)
        self._theta += turn
