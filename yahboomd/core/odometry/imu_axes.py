"""From the axes of the inertial sensor to those of the base.

Three words name the axes of the sensor that point forward, left and up, such as ``x -y -z`` for one
that lies on its back.
"""

from __future__ import annotations

import functools

import msgspec

from yahboomd.core.model import ImuReading, Vector3


def axes_problem(axes: str, *, rotation: bool) -> str:
    """The mistake in these words; empty if there is none.

    Args:
        axes: The three words.
        rotation: They must be a rotation. Some boards change signs, and show a mirror image.
    """
    words = axes.split()
    letters = [word.removeprefix("-") for word in words]
    if sorted(letters) != ["x", "y", "z"]:
        return "expected x, y and z once each, with or without a minus"
    even = "".join(letters) in {"xyz", "yzx", "zxy"}
    mirrored = sum(word.startswith("-") for word in words) % 2 == 1
    if rotation and even == mirrored:
        return "expected a rotation, and this is a mirror image: change one sign, or swap two axes"
    return ""


class Mounting:
    """The mounting and the calibration of a sensor.

    Args:
        axes: Its axes that point forward, left and up; empty: as its board is built.
        gyro_axes: The same for the gyro, if the board gives it other signs.
        gyro_factor: The true turn per turn that the gyro shows.
    """

    __slots__ = "_axes _gyro_axes _gyro_factor".split()

    def __init__(self, axes: str = "", gyro_axes: str = "", *, gyro_factor: float = 1.0) -> None:
        self._axes = axes
        self._gyro_axes = gyro_axes or axes
        self._gyro_factor = gyro_factor

    def along_base(self, reading: ImuReading) -> ImuReading:
        magnetic, usual = reading.magnetic_t, reading.sensor.axes
        axes = _places(self._axes or usual, 1.0)
        gyro_axes = _places(self._gyro_axes or usual, self._gyro_factor)
        return msgspec.structs.replace(
            reading,
            gyro_rad_s=_turned(gyro_axes, reading.gyro_rad_s),
            acceleration_m_s2=_turned(axes, reading.acceleration_m_s2),
            magnetic_t=None if magnetic is None else _turned(axes, magnetic),
        )


@functools.lru_cache(maxsize=8)
def _places(axes: str, factor: float) -> tuple[tuple[int, float], ...]:
    return tuple(
        ("xyz".index(word[-1]), -factor if word.startswith("-") else factor)
        for word in axes.split()
    )


def _turned(places: tuple[tuple[int, float], ...], shown: Vector3) -> Vector3:
    x, y, z = (factor * shown[axis] for axis, factor in places)
    return x, y, z
