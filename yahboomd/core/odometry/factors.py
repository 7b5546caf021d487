"""The factors that turn counts of single motors into motion of the body.

Law: a wheel's travel is the mean of its motors' travel, and the body's motion is linear in the
travel of the wheels. So every motor has three constant factors, and all of odometry is sums of
``factor * ticks``.
"""

from __future__ import annotations

from typing import NamedTuple

from yahboomd.core.errors import ConfigError
from yahboomd.core.model import Kinematics, Motor


class MotorFactors(NamedTuple):
    """The motion of the body by one count of one motor.

    Attributes:
        x: Travel forward, metres per tick.
        y: Travel to the left, metres per tick.
        turn: Counter-clockwise turn, radians per tick.
    """

    x: float
    y: float
    turn: float


def motor_factors(kinematics: Kinematics, motors: tuple[Motor, ...]) -> tuple[MotorFactors, ...]:
    """The factors of each motor, in the order of the motors.

    Motors that share a wheel (the two of a skid-steer side) share its travel in equal parts.

    Raises:
        ConfigError: A motor names a wheel that the geometry does not have, or a wheel has no motor.
    """
    sharing = [0] * len(kinematics.wheels)
    for motor in motors:
        if not 0 <= motor.wheel < len(sharing):
            raise ConfigError(
                f"motor {motor.name!r} turns wheel number {motor.wheel}, but a "
                f"{kinematics.name} base has {len(sharing)} wheels"
            )
        sharing[motor.wheel] += 1
    missing = [name for name, count in zip(kinematics.wheels, sharing, strict=True) if not count]
    if missing:
        raise ConfigError(f"no motor turns the wheel {' or '.join(missing)} of this base")
    along, across, turning = kinematics.forward
    factors = []
    for motor in motors:
        share = motor.metres_per_tick / sharing[motor.wheel]
        wheel = motor.wheel
        factors.append(
            MotorFactors(along[wheel] * share, across[wheel] * share, turning[wheel] * share)
        )
    return tuple(factors)
