"""The wirings that a board can drive.

A board that computes wheel speeds itself has a fixed plug for each motor. Each way to connect the
motors is checked with the board's dialect.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations, product

import msgspec

from yahboomd.core.config import Config
from yahboomd.core.errors import BoardError, Refused
from yahboomd.core.model import CHANNELS
from yahboomd.core.protocol.dialect import Dialect
from yahboomd.core.protocol.settings import BoardSettings
from yahboomd.tools.calibrate.estimates.wiring import WiredMotor, WiringFault, WiringFound, plain


def drivable(
    dialect: Dialect, settings: BoardSettings | None, config: Config, wheels: Sequence[str]
) -> list[tuple[WiredMotor, ...]]:
    """Find every way to connect the motors with which the board drives as commanded.

    Args:
        config: The robot; the wiring of its motors does not matter.
        wheels: The wheels with a motor, each with its motor's name.

    Raises:
        Refused: There is none: the board is set up for another robot.
    """
    kinematics = config.kinematics()
    motors = {motor.name: motor for motor in config.motors()}
    found, reason = [], ""
    for positions in permutations(range(1, CHANNELS + 1), len(wheels)):
        for signs in product((1, -1), repeat=len(wheels)):
            wiring = tuple(
                WiredMotor(wheel=wheel, position=position, sign=sign)
                for wheel, position, sign in zip(wheels, positions, signs, strict=True)
            )
            connected = tuple(
                msgspec.structs.replace(
                    motors[each.wheel],
                    position=each.position,
                    command_sign=each.sign,
                    encoder_sign=each.sign,
                )
                for each in wiring
            )
            try:
                dialect.motion(kinematics, connected, settings, scale=1.0)
            except BoardError as error:
                reason = str(error)
            else:
                found.append(wiring)
    if not found:
        raise Refused(f"The board cannot drive such a robot. {reason}")
    return found


def as_drivable(verdict: WiringFound, ways: Sequence[tuple[WiredMotor, ...]]) -> WiringFound:
    """Add the changes that the board needs to the verdict, if there are any.

    Args:
        verdict: A verdict on motors that all turned.
        ways: The result of :func:`drivable`.
    """
    has = {motor.wheel: motor for motor in verdict.motors}
    nearest = min(ways, key=lambda way: _changes(has, way))
    faults = []
    for motor in nearest:
        now, name = has[motor.wheel], plain(motor.wheel)
        if now.position != motor.position:
            words = (
                f"M{now.position} ({name}): this board drives its motors from plugs of its own. "
                f"Plug this motor and its encoder into M{motor.position}."
            )
        elif now.sign != motor.sign:
            words = (
                f"M{now.position} ({name}) is mounted the other way round, and this board cannot "
                "correct that. Swap the motor's two wires, and the two signal wires of its "
                "encoder, A and B."
            )
        else:
            continue
        faults.append(
            WiringFault("motor_misplaced", now.position, motor.wheel, words, motor.position)
        )
    if not faults:
        return verdict
    return msgspec.structs.replace(verdict, motors=nearest, faults=(*verdict.faults, *faults))


def _changes(has: dict[str, WiredMotor], way: tuple[WiredMotor, ...]) -> tuple[int, int]:
    """A sort key: the number of changes of plugs and of directions, then of plugs alone."""
    pairs = [(has[motor.wheel], motor) for motor in way]
    moved = sum(now.position != then.position for now, then in pairs)
    return moved + sum(now.sign != then.sign for now, then in pairs), moved
