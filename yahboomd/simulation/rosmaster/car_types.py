"""The cars that the simulated board can be set to: speeds of the wheels, and back.

Motors are M1 front left, M2 rear left, M3 front right, M4 rear right.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from yahboomd.simulation.rosmaster.rosmaster_flash import short, single

STEERING_LIMIT_DEG = 45

KEEPS_ANGLE = 0xFF
"""In place of an angle: keep the present one."""

_DEGREES, _RADIAN = single(57.2957795), single(0.0174532925)


class CarType(msgspec.Struct, frozen=True, kw_only=True):
    """A row of the firmware's tables.

    Attributes:
        circle_mm: Of a wheel.
        circle_counts: Counts of one turn.
        half_mm: Half of length and width, by which a turn is divided; the width of one that steers.
        clamp_mm_s: The limit of each wheel by itself.
        sideways: Whether vy is obeyed.
        axles_mm: From axle to axle, of one that steers.
        dead_zone: PWM units that are added to each output but 0.
    """

    circle_mm: float
    circle_counts: float
    half_mm: float
    clamp_mm_s: int = 1000
    sideways: bool = True
    axles_mm: float = 0.0
    dead_zone: int = 1600

    @property
    def mm_s_per_tick(self) -> float:
        """Rim speed that one count in 10 ms stands for."""
        return 100.0 * self.circle_mm / self.circle_counts

    def wheels(self, vx: int, vy: int, wz: int) -> tuple[int, ...]:
        """Speeds of the motors in mm/s, of a car that does not steer."""
        turn = single(single(wz / 1000.0) * single(self.half_mm))
        side = vy if self.sideways else 0
        wanted = (
            single(vx - side) - turn,
            single(vx + side) - turn,
            single(vx + side) + turn,
            single(vx - side) + turn,
        )
        return tuple(self._clamped(single(each)) for each in wanted)

    def steered(self, vx: int, wz: int, angle_deg: int) -> tuple[tuple[int, ...], int]:
        """Speeds of the motors in mm/s, and the angle of the steering in degrees, + left.

        Args:
            vx: Not 0.
            wz: Determines the angle if ``angle_deg`` is 0.
            angle_deg: Within the limit.
        """
        angle = single(angle_deg * _RADIAN)
        if angle_deg == 0:
            ratio = single(single(single(wz / 1000.0) * single(self.axles_mm)) / vx)
            angle = single(math.atan(ratio))
            angle_deg = limited(int(single(angle * _DEGREES)))
        return self.rear_wheels(vx, angle), angle_deg

    def rear_wheels(self, vx: int, angle: float) -> tuple[int, ...]:
        """Speeds of the motors in mm/s for an angle of the steering in radians, + left."""
        share = single(self.half_mm) * math.tan(angle) / 2.0 / single(self.axles_mm)
        return 0, self._clamped(vx * (1.0 - share)), 0, self._clamped(vx * (1.0 + share))

    def run(self, state: int, speed: int) -> tuple[int, int, int]:
        """The velocity of one of the states 1 to 6: ahead, back, left, right, spins."""
        if self.axles_mm:
            angle = (KEEPS_ANGLE, KEEPS_ANGLE, 25, -25, 45, -45)[state - 1]
            return short(-speed if state == 2 else speed), angle, 0
        aside = (0, speed, 0) if self.sideways else (speed // 2, 0, speed * 2)
        vx, vy, wz = {
            1: (speed, 0, 0),
            2: (-speed, 0, 0),
            3: aside,
            4: (aside[0], -aside[1], -aside[2]),
            5: (0, 0, speed * 5),
            6: (0, 0, -speed * 5),
        }[state]
        return short(vx), short(vy), short(wz)

    def body(self, deltas: Sequence[int], steering_deg: int) -> tuple[int, int, int]:
        """The board's idea of its velocity: mm/s, mm/s (the angle, of one that steers), mrad/s.

        Args:
            deltas: Counts of the motors in 10 ms.
        """
        circle, counts = single(self.circle_mm), single(self.circle_counts)
        half = single(self.half_mm)
        a, b, c, d = (single(single(100 * each * circle) / counts) for each in deltas)
        if self.axles_mm:
            turn = single(single(single(d - b) * 1000.0) / half)
            return int(single(b + d) / 2.0), steering_deg, int(turn)
        ahead = single(single(single(a + b) + c) + d) / 4.0
        side = single(single(single(a - b) - c) + d) / -4.0 if self.sideways else 0.0
        turn = single(single(single(a + b) - c) - d) / -4.0
        return int(ahead), int(side), int(single(single(turn / half) * 1000.0))

    def _clamped(self, mm_s: float) -> int:
        return max(-self.clamp_mm_s, min(self.clamp_mm_s, int(mm_s)))


def limited(angle_deg: int) -> int:
    """The angle within the limits of the steering."""
    return max(-STEERING_LIMIT_DEG, min(STEERING_LIMIT_DEG, angle_deg))


CAR_TYPES: dict[int, CarType] = {
    1: CarType(circle_mm=204.203, circle_counts=1320, half_mm=164.555),
    2: CarType(circle_mm=251.327, circle_counts=2464, half_mm=214.1, clamp_mm_s=700),
    4: CarType(circle_mm=215.2, circle_counts=1320, half_mm=164.555, sideways=False),
    5: CarType(circle_mm=215.2, circle_counts=836, half_mm=191.1, clamp_mm_s=2000, axles_mm=235.37),
    6: CarType(circle_mm=204.203, circle_counts=1040, half_mm=143.68, dead_zone=2000),
    10: CarType(circle_mm=251.327, circle_counts=2464, half_mm=189.5, clamp_mm_s=700),
}
"""X3, X3 Plus, X1, R2, Sunrise of firmware 3.5.1, and the M1 of 3.6."""

X3_PLUS, R2, SUNRISE, M1 = 2, 5, 6, 10

TYPES = 7
"""It accepts types below this, and obeys few commands with a type that it does not drive."""

M1_FIRMWARE = (3, 6)


def accepts(car_type: int, firmware: str) -> bool:
    """Whether a board stores this type."""
    major, minor = (int(part) for part in firmware.split(".")[:2])
    return car_type < TYPES or (car_type == M1 and (major, minor) >= M1_FIRMWARE)
