"""The robot as configured, and whether a board fits it."""

from __future__ import annotations

from typing import Literal

import msgspec

from yahboomd.core.drive.faults import Fault
from yahboomd.core.drive.limiter import AxisCaps
from yahboomd.core.drive.loop_law import UNKNOWN_LAW, LoopLaw, loop_law
from yahboomd.core.drive.rest import AtRest
from yahboomd.core.errors import BoardError
from yahboomd.core.link.handshake import Identity
from yahboomd.core.model import Kinematics, Motor
from yahboomd.core.odometry.imu_axes import Mounting
from yahboomd.core.protocol.dialect import Motion
from yahboomd.core.protocol.profiles import MotorProfile

BLIND_S = 0.3
"""Without counts for this time a robot stands: unseen wheels are not driven."""


class ControlOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Facts of this robot that the control path needs.

    Attributes:
        motors: The motors, in the order of the geometry's wheels.
        command_scale: Multiplier on command units.
        linear: Limits of vx and vy.
        angular: Limits of wz.
        at_rest: The treatment of standing wheels.
        stall: The reaction to a wheel that stands against its command.
        turns_without_command: The reaction to a wheel that turns by itself.
        min_speed_m_s: Commands below it prove nothing about missing counts.
        period_s: From one control step to the next.
        blind_s: The same as :data:`BLIND_S`, of a board that has to be asked for its counts.
        battery_scale: The true volts per reported one.
        battery_low_v: Volts at rest below which a warning is published; None for never.
        battery_stop_v: Below it programs begin no motion; None for never.
        release: The command of a terminal that releases this robot's e-stop.
    """

    kinematics: Kinematics
    motors: tuple[Motor, ...]
    profile: MotorProfile
    command_scale: float = 1.0
    linear: AxisCaps = AxisCaps()
    angular: AxisCaps = AxisCaps()
    at_rest: AtRest = "auto"
    stall: Literal["stop", "report"] = "stop"
    turns_without_command: Literal["stop", "report"] = "report"
    min_speed_m_s: float = 0.08
    period_s: float = 0.02
    blind_s: float = BLIND_S
    battery_scale: float = 1.0
    battery_low_v: float | None = None
    battery_stop_v: float | None = None
    release: str = "yahboomd stop --release"
    mounting: Mounting = Mounting()

    def cuts(self, fault: Fault) -> bool:
        """Whether this fault releases the motors until a person clears it."""
        if fault.action in {"cut", "report"}:
            return fault.action == "cut"
        if fault.kind == "turns_without_command":
            return self.turns_without_command == "stop"
        return self.stall == "stop"


class BoardFit(msgspec.Struct, frozen=True, kw_only=True):
    """The consequences of a board's settings.

    Attributes:
        motion: The commands of the wheels; None if they must not turn.
        law: How its speed loop winds up.
        wrong: Why its wheels must not turn, a sentence each with the remedy; empty if they may.
    """

    motion: Motion | None
    wheel_limits: tuple[float, ...]
    law: LoopLaw = UNKNOWN_LAW
    wrong: tuple[str, ...] = ()


def no_board(kinematics: Kinematics) -> BoardFit:
    return BoardFit(motion=None, wheel_limits=(0.0,) * len(kinematics.wheels))


def fit(
    identity: Identity,
    *,
    kinematics: Kinematics,
    motors: tuple[Motor, ...],
    profile: MotorProfile,
    scale: float,
) -> BoardFit:
    """Compare a board with the configuration.

    Args:
        scale: The calibration multiplier of commands.
    """
    settings, dialect = identity.settings, identity.dialect
    nothing = no_board(kinematics)
    wrong = dialect.findings(settings, profile).unfit if settings is not None else ()
    if wrong:
        return msgspec.structs.replace(nothing, wrong=wrong)
    try:
        motion = dialect.motion(kinematics, motors, settings, scale=scale)
    except BoardError as error:
        return msgspec.structs.replace(nothing, wrong=(str(error),))
    return BoardFit(motion=motion, wheel_limits=motion.wheel_limits, law=loop_law(settings))
