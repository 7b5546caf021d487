"""How an inertial sensor is mounted, and the scale of its gyro: by turning the robot by hand.

At rest the accelerometer shows which of its axes points up, for gravity pulls the other way. A turn
to the left shows the same for the gyro, and whole turns show its scale. The forward axis remains
unknown: if the up axis is wrong, the others are guessed, and the heading does not depend on them.
"""

from __future__ import annotations

import math

import msgspec

from yahboomd.core.model import Vector3

FLAT_SHARE = 0.95
"""The least share of a turn on the floor that is about a single axis."""

NEAR = 0.2
"""The largest error of the gyro's turns, and of gravity, as a share."""

GRAVITY_M_S2 = 9.80665


class Mounted(msgspec.Struct, frozen=True, kw_only=True):
    """The findings of a turn by hand.

    Attributes:
        gyro_axes: For ``imu.gyro_axes``; empty if they are those of the accelerometer.
        turns: The number of turns by the gyro, in either direction.
        doubts: The reasons not to trust this, a sentence each.
    """

    axes: str
    gyro_axes: str
    gyro_scale: float
    turns: float
    doubts: tuple[str, ...] = ()


def judge(
    angles: Vector3, force_m_s2: Vector3, turns: float, *, axes: str, gyro_axes: str, scale: float
) -> Mounted:
    """Judge a turn to the left.

    Args:
        angles: The integrals of the gyro about x, y and z, without its bias; radians.
        force_m_s2: The accelerometer's output at rest.
        gyro_axes: As configured; empty: those of the accelerometer.
    """
    doubts = []
    about, whole = _largest(angles), 2.0 * math.pi * turns
    angle, size = angles[about], math.hypot(*angles)
    seen = size / (2.0 * math.pi)
    if size < (1.0 - NEAR) * whole or size > (1.0 + NEAR) * whole:
        doubts.append(f"The gyro saw {seen:.2f} turns, and {turns:g} were asked for.")
    elif abs(angle) < FLAT_SHARE * size:
        doubts.append("The robot was not turned about one axis: keep it flat on the floor.")
    pulled = _largest(force_m_s2)
    if abs(abs(force_m_s2[pulled]) / GRAVITY_M_S2 - 1.0) > NEAR:
        doubts.append(
            f"At rest no axis showed gravity: {force_m_s2[pulled]:.1f} m/s^2 at most. The sensor "
            "is mounted at a slant, or the robot moved."
        )
    new = _with_up(axes, pulled, force_m_s2[pulled])
    new_gyro = _with_up(gyro_axes or axes, about, angle)
    return Mounted(
        axes=new,
        gyro_axes="" if new_gyro.split()[2] == new.split()[2] else new_gyro,
        gyro_scale=round(scale * whole / abs(angle), 5) if angle else scale,
        turns=seen,
        doubts=tuple(doubts),
    )


def _largest(vector: Vector3) -> int:
    return max(range(3), key=lambda axis: abs(vector[axis]))


def _with_up(axes: str, up: int, sign: float) -> str:
    """The axes, changed so that the axis at index ``up`` (reversed if ``sign`` < 0) points up."""
    if up == 2 and sign > 0.0:
        return axes
    words = axes.split()
    top = words.pop(up)
    if sign < 0.0:
        top = top.removeprefix("-") if top.startswith("-") else f"-{top}"
    forward, left = words[0], words[1].removeprefix("-")
    even = (forward[-1] + left + top[-1]) in {"xyz", "yzx", "zxy"}
    minus = (forward.startswith("-") != top.startswith("-")) == even
    return f"{forward} {'-' if minus else ''}{left} {top}"
