"""The settings that the Rosmaster board stores, and the numbers of its processor."""

from __future__ import annotations

import struct

import msgspec

WRITE_NS = 80_000_000
"""A write of one setting: its page is erased and written, and nothing else is executed."""

IN_FLASH = 0x5F
"""The save byte: a setting goes to the flash, too."""


class RosmasterStored(msgspec.Struct, frozen=True, kw_only=True):
    """The settings that the board keeps over a reset, and the sensor that is soldered to it.

    Attributes:
        car_type: As the firmware numbers them; one above 6 belongs to other firmware.
        auto_report: 1 if it sends reports by itself.
        steering_centre: The servo's angle that is taken for straight ahead, in degrees.
        imu: ``mpu9250``, ``icm20948``, or empty.
    """

    car_type: int = 1
    auto_report: int = 1
    p: float = 0.8
    i: float = 0.06
    d: float = 0.5
    yaw_p: float = 0.4
    yaw_i: float = 0.0
    yaw_d: float = 0.1
    steering_centre: int = 90
    imu: str = "mpu9250"


_SINGLE = struct.Struct("<f")


def single(value: float) -> float:
    """The number as the board's float of 32 bits."""
    return float(_SINGLE.unpack(_SINGLE.pack(value))[0])


def thousandths(gain: float) -> int:
    """A gain as the board shows and stores it: multiplied as such a float, and cut."""
    return int(single(single(gain) * 1000.0))


def short(value: float) -> int:
    """The number in 16 bits, as the board cuts it: it wraps."""
    return (int(value) + 0x8000) % 0x1_0000 - 0x8000
