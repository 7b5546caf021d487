"""The control path's options: facts of its robot."""

from __future__ import annotations

from typing import Literal

import msgspec

from yahboomd.drive.faults import Fault
from yahboomd.drive.limiter import AxisLimits
from yahboomd.model import Kinematics, Motor
from yahboomd.protocol.settings import MotorProfile


class ControlOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Facts of this robot that the control path needs.

    Attributes:
        kinematics: The drive geometry.
        motors: The motors, in the order of the geometry's wheels.
        profile: The motors' kind.
        command_scale: Multiplier on command units.
        linear: Limits of vx and vy.
        angular: Limits of wz.
        at_rest: Hold the wheels once they stand, or let them go.
        stall: What follows from a wheel that stands against its command.
        turns_without_command: What follows from a wheel that turns by itself.
        min_speed_m_s: Commands below it prove nothing about counts that stay away.
        period_s: From one control step to the next.
        blind_s: Without counts for so long it stands: unseen wheels are not driven.
    """

    kinematics: Kinematics
    motors: tuple[Motor, ...]
    profile: MotorProfile
    command_scale: float = 1.0
    linear: AxisLimits = AxisLimits()
    angular: AxisLimits = AxisLimits()
    at_rest: Literal["hold", "release"] = "hold"
    stall: Literal["stop", "report"] = "stop"
    turns_without_command: Literal["stop", "report"] = "report"
    min_speed_m_s: float = 0.08
    period_s: float = 0.02
    blind_s: float = 0.3

    def cuts(self, fault: Fault) -> bool:
        """Whether the motors are let go for this fault, until a person clears it."""
        if fault.action != "policy":
            return fault.action == "cut"
        if fault.kind == "turns_without_command":
            return self.turns_without_command == "stop"
        return self.stall == "stop"
