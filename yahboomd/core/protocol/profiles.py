"""The motors that robots are built with: the vendor's, by name."""

from __future__ import annotations

from typing import Final

import msgspec

from yahboomd.core.protocol.settings import BoardSettings

EDGES_PER_LINE: Final = 4
"""The board counts both edges of both phases."""

NO_ENCODER_TYPE: Final = 4
"""The stored motor type that means: without encoder."""


FASTEST_RATIO: Final = 19.0


class MotorProfile(msgspec.Struct, frozen=True, kw_only=True):
    """A motor with its gear and wheel, as built.

    Attributes:
        stored: Other settings that their board should store; missing ones stay as they are.
        lines: Encoder lines of one turn of the motor.
        ratio: The true gear ratio, decimals included.
    """

    name: str
    stored: BoardSettings
    lines: int
    ratio: float
    wheel_diameter_mm: float

    @property
    def ticks_per_revolution(self) -> float:
        return self.lines * self.ratio * EDGES_PER_LINE

    @property
    def least_ticks_per_revolution(self) -> float:
        """The same if the wheel has the fastest gear that is sold, and the profile is wrong."""
        return self.lines * min(self.ratio, FASTEST_RATIO) * EDGES_PER_LINE

    @property
    def wheel_radius_m(self) -> float:
        return self.wheel_diameter_mm / 2000.0

    @property
    def settings(self) -> BoardSettings:
        """The settings that suit this motor. The speed loop's gains are left alone."""
        return {
            **self.stored,
            "lines": self.lines,
            "ratio": self.ratio,
            "wheel_diameter_mm": self.wheel_diameter_mm,
        }


_MOTORS: Final[tuple[tuple[str, BoardSettings, int, float, float], ...]] = (
    ("520", {"motor_type": 1, "deadzone": 1900}, 11, 30.0, 67.0),
    ("520-1:19", {"motor_type": 1, "deadzone": 1900}, 11, 19.0, 67.0),
    ("520-1:56", {"motor_type": 1, "deadzone": 1900}, 11, 56.0, 67.0),
    ("l520", {"motor_type": 1, "deadzone": 1900}, 11, 40.0, 67.0),
    # Sold as 1:20, and the board can store only 20.
    ("310", {"motor_type": 2, "deadzone": 1600}, 13, 20.409, 48.0),
    ("tt", {"motor_type": 3, "deadzone": 1250}, 13, 45.0, 68.0),
    # Whole cars, as their board's firmware has them.
    ("x3", {"car_type": 1}, 11, 30.0, 65.0),
    ("x3-plus", {"car_type": 2}, 11, 56.0, 80.0),
    ("x1", {"car_type": 4}, 11, 30.0, 68.5),
    ("r2", {"car_type": 5}, 11, 19.0, 68.5),
    ("sunrise", {"car_type": 6}, 13, 20.0, 65.0),
    ("m1", {"car_type": 10}, 11, 56.0, 80.0),
)

PROFILES: Final[dict[str, MotorProfile]] = {
    name: MotorProfile(
        name=name,
        stored=stored,
        lines=lines,
        ratio=ratio,
        wheel_diameter_mm=wheel_diameter_mm,
    )
    for name, stored, lines, ratio, wheel_diameter_mm in _MOTORS
}
"""The vendor's motors by name. The TT motor without encoder is missing: it gives no odometry."""


NOTES: Final = {"r2": "R2 and R2L", "m1": "firmware 3.6 or later"}
"""What a person who chooses a profile should know."""

TYPES: Final = ("motor_type", "car_type")
"""The stored values that say which motors, or which car, the board believes it drives. They change
the signs of its encoders, the law of its wheels and the limits of its battery."""


def of_its_board(profile: MotorProfile) -> tuple[MotorProfile, ...]:
    return tuple(each for each in PROFILES.values() if each.stored.keys() & profile.stored.keys())


def alike(profile: MotorProfile) -> tuple[MotorProfile, ...]:
    """The profiles with the same stored type: they differ in gear and wheel alone."""

    def types(motors: MotorProfile) -> list[object]:
        return [motors.stored.get(name) for name in TYPES]

    return tuple(each for each in PROFILES.values() if types(each) == types(profile))
