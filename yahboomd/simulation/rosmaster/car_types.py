"""The cars that the simulated board can be set to: speeds of the wheels, and back.

Motors are M1 front left, M2 rear left, M3 front right, M4 rear right.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from yahboomd.core.model import CHANNELS

STEERING_LIMIT_DEG = 45


class CarType(msgspec.Struct, frozen=True, kw_only=True):
    """A row of the firmware's tables.

    Attributes:
        circle_mm: Of a wheel.
        circle_counts: Counts of one turn.
        half_mm: Half of length and width, by which a turn is divided; the width of one that steers.
        clamp_mm_s: Each wheel alone is limited to it.
        sideways: Whether vy is obeyed.
        axles_mm: From axle to axle, of one that steers.
    """

    circle_mm: float
    circle_counts: float
    half_mm: float
    clamp_mm_s: int = 1000
    sideways: bool = True
    axles_mm: float = 0.0

    @property
    def mm_s_per_tick(self) -> float:
        """Rim speed that one count in 10 ms stands for."""
        return 100.0 * self.circle_mm / self.circle_counts

    def wheels(self, vx: int, vy: int, wz: int) -> tuple[tuple[int, ...], int]:
        """Speeds of the motors in mm/s, and the angle of the steering in degrees, + left."""
        if self.axles_mm:
            return self._steered(vx, vy, wz)
        turn = wz / 1000.0 * self.half_mm
        side = vy if self.sideways else 0
        wanted = (vx - side - turn, vx + side - turn, vx + side + turn, vx - side + turn)
        return tuple(self._clamped(each) for each in wanted), 0

    def _steered(self, vx: int, vy: int, wz: int) -> tuple[tuple[int, ...], int]:
        angle_deg = max(-STEERING_LIMIT_DEG, min(STEERING_LIMIT_DEG, vy))
        if vx == 0:
            return (0,) * CHANNELS, angle_deg
        angle = math.radians(angle_deg)
        if angle_deg == 0:
            angle = math.atan(wz / 1000.0 * self.axles_mm / vx)
            angle_deg = int(math.degrees(angle))
            angle_deg = max(-STEERING_LIMIT_DEG, min(STEERING_LIMIT_DEG, angle_deg))
        share = self.half_mm * math.tan(angle) / 2.0 / self.axles_mm
        left, right = self._clamped(vx * (1.0 - share)), self._clamped(vx * (1.0 + share))
        return (0, left, 0, right), angle_deg

    def body(self, speeds: Sequence[float], steering_deg: int) -> tuple[int, int, int]:
        """The board's idea of its velocity: mm/s, mm/s (the angle, of one that steers), mrad/s."""
        a, b, c, d = speeds
        if self.axles_mm:
            return int((b + d) / 2.0), steering_deg, int((d - b) * 1000.0 / self.half_mm)
        vy = (-a + b + c - d) / 4.0 if self.sideways else 0.0
        return (
            int((a + b + c + d) / 4.0),
            int(vy),
            int((-a - b + c + d) / 4.0 / self.half_mm * 1000.0),
        )

    def _clamped(self, mm_s: float) -> int:
        return max(-self.clamp_mm_s, min(self.clamp_mm_s, int(mm_s)))


CAR_TYPES: dict[int, CarType] = {
    1: CarType(circle_mm=204.203, circle_counts=1320, half_mm=164.555),
    2: CarType(circle_mm=251.327, circle_counts=2464, half_mm=214.1, clamp_mm_s=700),
    4: CarType(circle_mm=215.2, circle_counts=1320, half_mm=164.555, sideways=False),
    5: CarType(circle_mm=215.2, circle_counts=836, half_mm=191.1, clamp_mm_s=2000, axles_mm=235.37),
    6: CarType(circle_mm=204.203, circle_counts=1040, half_mm=143.68),
}
"""The types that firmware 3.5.1 knows: X3, X3 Plus, X1, R2, Sunrise."""
