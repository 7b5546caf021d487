"""The sections on motion: limits, commands, faults, emergency stop."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from yahboomd.core.config.values import AbsolutePath, Key, Positive, Section, SourceKey
from yahboomd.core.drive import limiter as drive
from yahboomd.core.drive.rest import AtRest


class AxisLimits(Section):
    """The limits of one axis; without a jerk, the acceleration may change at once."""

    velocity: Positive | None = Field(
        default=None, description="Greatest speed: m/s (linear), rad/s (angular)."
    )
    acceleration: Positive | None = Field(
        default=None, description="Greatest gain of speed: m/s^2, rad/s^2."
    )
    deceleration: Positive | None = Field(
        default=None, description="Greatest loss of speed: m/s^2, rad/s^2."
    )
    jerk: Positive | None = Field(
        default=None, description="Greatest change of acceleration: m/s^3, rad/s^3."
    )

    def noun(self) -> drive.AxisCaps:
        return drive.AxisCaps(
            velocity=self.velocity,
            acceleration=self.acceleration,
            deceleration=self.deceleration,
            jerk=self.jerk,
        )


LINEAR = AxisLimits(velocity=1.0, acceleration=2.5, deceleration=5.0)
ANGULAR = AxisLimits(velocity=6.0, acceleration=12.0, deceleration=24.0)


def _over(default: AxisLimits) -> Callable[[object], object]:
    """Fill a table with the entries of a default that it leaves out."""
    return lambda given: {**default.as_data(), **given} if isinstance(given, dict) else given


class Limits(Section):
    """Limits of the base's motion.

    Each entry that is given replaces its default, and the others stay. To drive without a ramp,
    give an acceleration that no base reaches, such as 1e6.
    """

    # Lowering the speed must not remove the ramps.
    linear: Annotated[AxisLimits, BeforeValidator(_over(LINEAR))] = Field(
        default=LINEAR, description="Forward and sideways: m/s, m/s^2, m/s^2, m/s^3."
    )
    angular: Annotated[AxisLimits, BeforeValidator(_over(ANGULAR))] = Field(
        default=ANGULAR, description="Turning: rad/s, rad/s^2, rad/s^2, rad/s^3."
    )


class Source(Section):
    """One key that may command the wheels."""

    priority: int = Field(
        default=10,
        ge=-1_000_000,
        le=1_000_000,
        description="The larger number wins; among equals the source in control keeps it.",
    )
    timeout_s: float | None = Field(
        default=None,
        gt=0.0,
        le=60.0,
        description="Seconds until this source's silence stops the wheels. Absent: "
        "command.timeout_s.",
    )


class Command(Section):
    """The sources of commands, the age of a command, and the stop when commands end."""

    timeout_s: float = Field(
        default=0.5,
        gt=0.0,
        le=60.0,
        description="Seconds of command silence until the wheels stop, by themselves.",
    )
    on_timeout: Literal["ramp", "halt"] = Field(
        default="ramp",
        description="How the wheels stop after timeout_s, and when another source takes over: "
        "within the limits, or at once. Every other stop is immediate.",
    )
    rate_hz: float = Field(
        default=50.0,
        ge=1.0,
        le=1000.0,
        description="Control steps per second, 10 at least; a new command also runs one "
        "immediately.",
    )
    resend_s: float = Field(
        default=0.1,
        gt=0.0,
        le=10.0,
        description="Seconds after which an unchanged speed is sent again, because the board may "
        "lose one.",
    )
    stamps: Literal["relative", "absolute", "ignore"] = Field(
        default="relative",
        description="How the age of a command is computed from its stamp. relative: by the "
        "source's own clock, which need not agree with this machine's; absolute: by this "
        "machine's clock; ignore: every command counts as new.",
    )
    at_rest: AtRest = Field(
        default="auto",
        description="Once the wheels stand. auto: let them go after 2 s, and hold them until the "
        "next drive if one rolls by 5 mm; hold: the board holds them, and goes on feeding the "
        "motors; release: let them go at once, and let them roll.",
    )
    sources: dict[SourceKey, Source] = Field(
        default={
            "cmd_vel": Source(priority=10),
            "cmd_vel/teleop": Source(priority=100, timeout_s=0.3),
            "cmd_vel/web": Source(priority=50, timeout_s=0.3),
            "cmd_vel/moves": Source(priority=5, timeout_s=0.3),
        },
        description="The keys, below the namespace, on which velocity commands arrive. Given in "
        "a file, they replace the default ones.",
    )


class Faults(Section):
    """Reactions when wheels and commands disagree.

    A wheel that runs away, or turns against its command, is always cut.
    """

    stall: Literal["stop", "report"] = Field(
        default="stop",
        description="When a wheel stands against its command, or does not begin to turn: stop the "
        "base, or only report it.",
    )
    turns_without_command: Literal["stop", "report"] = Field(
        default="report",
        description="When a wheel turns though none was commanded (a hand, a slope): stop, or "
        "only report it.",
    )
    min_speed_m_s: float = Field(
        default=0.08,
        gt=0.0,
        le=1.0,
        description="Commanded rim speed in m/s from which a wheel that rolled and stops counting "
        "is at fault at once. Below it, it has the time of one that does not begin to turn.",
    )


class Estop(Section):
    """The emergency stop: what else engages it, and its memory."""

    groups: tuple[Key, ...] = Field(
        default=(),
        strict=False,
        description="Groups that stop together, such as a site and a fleet: the e-stop on "
        "GROUP/yahboomd/estop stops this robot too.",
    )
    latch_file: AbsolutePath = Field(
        default="",
        description="File that remembers an engaged emergency stop over a restart. Empty: estop "
        "in $RUNTIME_DIRECTORY, else in /run/yahboomd (root), $XDG_RUNTIME_DIR/yahboomd or "
        "/tmp/yahboomd-<user id>; with the namespace and the port in its name.",
    )
