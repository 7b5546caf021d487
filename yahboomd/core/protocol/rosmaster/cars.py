"""The cars that the board knows, and how each turns a velocity of the body into wheel speeds.

The board takes vx, vy and wz and divides them among its motors by the car type that it stores. So
the wanted wheel speeds are converted back to such a velocity, by the same law. Wheels that this law
cannot turn as wanted are refused: they would roll differently than commanded.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, TypeAlias

import msgspec

from yahboomd.core.errors import BoardError
from yahboomd.core.model import Kinematics, Motor
from yahboomd.core.protocol.dialect import Units

Row: TypeAlias = tuple[float, float, float]
"""The factors of vx, vy (mm/s) and wz (rad/s) in a motor's speed (mm/s)."""

MISFIT: Final = 0.05
"""A share of the fastest wheel: wheels of slightly different radii are still the same geometry."""


STEERS_DEG: Final = 45
"""The largest angle that the board takes."""


class Car(msgspec.Struct, frozen=True):
    """A car type.

    Attributes:
        name: The name under which it is sold.
        turn_mm: The travel of one turn of a wheel, by the board.
        turn_counts: Counts of one turn, by the board.
        motors: The law of each motor that it drives, by position.
        fastest_mm_s: The limit of each single motor.
        wheelbase_mm: From axle to axle, of a car that steers; None for the others.
    """

    name: str
    turn_mm: float
    turn_counts: int
    motors: dict[int, Row]
    fastest_mm_s: int
    wheelbase_mm: float | None = None


def _mecanum(k_mm: float) -> dict[int, Row]:
    return {
        1: (1.0, -1.0, -k_mm),
        2: (1.0, 1.0, -k_mm),
        3: (1.0, 1.0, k_mm),
        4: (1.0, -1.0, k_mm),
    }


def _four_wheels(k_mm: float) -> dict[int, Row]:
    return {1: (1.0, 0.0, -k_mm), 2: (1.0, 0.0, -k_mm), 3: (1.0, 0.0, k_mm), 4: (1.0, 0.0, k_mm)}


def _rear_wheels(track_mm: float) -> dict[int, Row]:
    return {2: (1.0, 0.0, -track_mm / 2.0), 4: (1.0, 0.0, track_mm / 2.0)}


CARS: Final = {
    1: Car("X3", 204.203, 1320, _mecanum(164.555), 1000),
    2: Car("X3 Plus", 251.327, 2464, _mecanum(214.1), 700),
    4: Car("X1", 215.2, 1320, _four_wheels(164.555), 1000),
    5: Car("R2", 215.2, 836, _rear_wheels(191.1), 2000, wheelbase_mm=235.37),
    6: Car("Sunrise", 204.203, 1040, _mecanum(143.68), 1000),
    10: Car("M1", 251.327, 2464, _mecanum(189.5), 700),
}
"""The car types by number, as the firmware has them; the wheels of X3 and Sunrise are alike."""

M1, M1_FIRMWARE = 10, (3, 6)
"""The first firmware that knows the M1; older ones ignore its number."""

NO_LAW: Final = {9: "A1"}
"""Cars whose number is known, and of whose law nothing was published."""

ALSO: Final = {5: "R2 or R2L"}
"""Cars that share a number."""


def car_name(number: int) -> str:
    """The car of a type, for people."""
    if car := CARS.get(number):
        return ALSO.get(number, car.name)
    return NO_LAW.get(number, "unknown")


class Body(msgspec.Struct, frozen=True, kw_only=True):
    """A motion as the velocity of the body; see :class:`~yahboomd.core.protocol.dialect.Motion`.

    Attributes:
        rows: For vx (mm/s), vy (mm/s) and wz (mrad/s) the factors of each wheel's rim speed (m/s).
    """

    rows: tuple[tuple[float, ...], ...]
    wheel_limits: tuple[float, ...]

    def units(self, speeds: Sequence[float]) -> Units:
        """The velocity of the body, in mm/s and mrad/s, that turns the wheels at these speeds."""
        if not all(map(math.isfinite, speeds)):
            raise ValueError(f"The command is {speeds}.")
        return tuple(
            round(sum(factor * speed for factor, speed in zip(row, speeds, strict=True)))
            for row in self.rows
        )


class Steered(msgspec.Struct, frozen=True, kw_only=True):
    """A motion of a car that steers: its speed, and the angle of the steering in whole degrees.

    Attributes:
        rear: The motion of the rear wheels alone.
    """

    rear: Body
    kinematics: Kinematics
    wheel_limits: tuple[float, ...]

    def units(self, speeds: Sequence[float]) -> Units:
        """The speed in mm/s, and the angle with which the front wheels roll along the curve.

        With the turn in mrad/s the board would compute the angle itself, and cut its decimals.
        """
        ahead_mm_s = self.rear.units(speeds)[0]
        ahead, _, turn = (_dot(row, speeds) for row in self.kinematics.forward)
        if not ahead_mm_s or not ahead:
            return 0, 0, 0
        angle = math.atan(turn / ahead * self.kinematics.base_m)
        return ahead_mm_s, max(-STEERS_DEG, min(STEERS_DEG, round(math.degrees(angle)))), 0


def steered(
    car: Car, kinematics: Kinematics, motors: tuple[Motor, ...], *, scale: float
) -> Steered:
    """The commands that drive this car; see :func:`body`.

    The board gets only speed and angle: both motors must be mounted alike, and each on its
    side, because the board speeds up the outer one by itself.

    Raises:
        BoardError: As :func:`body` does.
    """
    rear = body(car, kinematics, motors, scale=scale)
    along, _, about = rear.rows
    ahead, _, round_ = zip(*kinematics.inverse, strict=True)
    drives = _dot(along, ahead)
    if abs(_dot(along, round_)) > MISFIT * abs(drives) or drives * _dot(about, round_) <= 0.0:
        raise BoardError(
            f"The board is set to the car {car.name}, whose motors are mounted alike, left on M2 "
            "and right on M4; these are not.",
            remedy="Compare chassis.motors and their signs with the car: `yahboomd setup` finds "
            "what to change.",
        )
    return Steered(rear=rear, kinematics=kinematics, wheel_limits=rear.wheel_limits)


def body(car: Car, kinematics: Kinematics, motors: tuple[Motor, ...], *, scale: float) -> Body:
    """The commands that turn these wheels.

    With A the car's law, and S the motors' speeds in the board's measure for each wheel's speed,
    the board's velocity is the least-squares solution of A v = S w. The
    columns of A are orthogonal over any motors that are as many left as right.

    Args:
        car: The car type that the board stores.
        scale: The calibration multiplier of commands.

    Raises:
        BoardError: The car has no motor there, or turns its motors differently than needed.
    """
    wheels = range(len(kinematics.wheels))
    targets: dict[int, list[float]] = {}
    for motor in motors:
        if motor.position not in car.motors:
            raise BoardError(
                f"The board is set to car type {car.name}, which drives no motor at "
                f"M{motor.position}, where {motor.name} is.",
                remedy="Set chassis.motors to the connectors of the motors.",
            )
        mm_s = car.turn_mm / car.turn_counts / motor.metres_per_tick * scale * motor.command_sign
        targets[motor.position] = [mm_s if wheel == motor.wheel else 0.0 for wheel in wheels]
    law = {position: car.motors[position] for position in targets}
    norms = [sum(row[axis] ** 2 for row in law.values()) or 1.0 for axis in range(3)]
    solved = [
        [sum(law[at][axis] * targets[at][wheel] for at in law) / norms[axis] for wheel in wheels]
        for axis in range(3)
    ]
    if not kinematics.holonomic:
        solved[1] = [0.0 for _ in wheels]
    _check(car, kinematics, law, targets, solved)
    # The board counts a turn in mrad/s.
    rows = (solved[0], solved[1], [1000.0 * each for each in solved[2]])
    limits = [math.inf for _ in wheels]
    for motor in motors:
        share = abs(targets[motor.position][motor.wheel])
        # One unit less than the board's own limit, because of rounding.
        limits[motor.wheel] = min(limits[motor.wheel], (car.fastest_mm_s - 1) / share)
    return Body(rows=tuple(map(tuple, rows)), wheel_limits=tuple(limits))


def _check(
    car: Car,
    kinematics: Kinematics,
    law: dict[int, Row],
    targets: dict[int, list[float]],
    solved: list[list[float]],
) -> None:
    for axis, name in enumerate(("ahead", "sideways", "round")):
        wanted = [factors[axis] for factors in kinematics.inverse]
        goals = {at: _dot(target, wanted) for at, target in targets.items()}
        sent = [_dot(row, wanted) for row in solved]
        fastest = max(map(abs, goals.values()))
        if any(abs(_dot(law[at], sent) - goal) > MISFIT * fastest for at, goal in goals.items()):
            raise BoardError(
                f"The board is set to car type {car.name} and divides a motion among its motors "
                f"by itself; driving {name} it would turn the wheels of this {kinematics.name} "
                "base otherwise than they must turn.",
                remedy="Compare chassis.preset, chassis.motors and their signs with the car, and "
                "the car type with `yahboomd probe`.",
            )


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    return sum(x * y for x, y in zip(a, b, strict=True))
