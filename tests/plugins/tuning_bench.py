"""A tuning of a simulated board on virtual time, and how its wheels truly follow a step."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from typing import Any

import msgspec
from board_bench import LinkBench

from yahboomd.core.config import Config, read
from yahboomd.core.protocol.dialect import Dialect
from yahboomd.core.protocol.settings import BoardSettings
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.robot import SimulatedRobot
from yahboomd.tools.robot.simulated_robot import as_configured
from yahboomd.tools.tune.estimates.step_response import StepFigures, figures
from yahboomd.tools.tune.procedure import Procedure
from yahboomd.tools.tune.stand import Stand
from yahboomd.tools.tune.traces import TICK_S
from yahboomd.tools.tune.tuning_result import Result

SPEED_M_S = 0.4

STARTS: dict[str, dict[str, float]] = {
    "as sold": {"p": 0.8, "i": 0.06, "d": 0.5},
    "too soft": {"p": 0.1, "i": 0.01, "d": 0.0},
    "too soft, no dead zone stored": {"p": 0.1, "i": 0.02, "d": 0.0, "dead_zone": 0},
    "no dead zone stored": {"p": 0.8, "i": 0.06, "d": 0.5, "dead_zone": 0},
    "oscillates slowly": {"p": 0.1, "i": 0.15, "d": 0.0},
    "oscillates": {"p": 0.3, "i": 0.6, "d": 0.0},
    "chatters": {"p": 8.0, "i": 1.0, "d": 0.0},
}
"""Badly tuned boards; one has to begin with none of its motors' figures known."""

FOUR_CHANNEL = ("520", "520-1:19", "520-1:56", "l520", "310", "tt")
CARS = {
    "x3": ("chassis.preset=mecanum", "chassis.wheel_base_m=0.16"),
    "x3-plus": ("chassis.preset=mecanum", "chassis.wheel_base_m=0.2"),
    "x1": ("chassis.preset=4wd",),
    "r2": ("chassis.preset=ackermann", "chassis.wheel_base_m=0.235"),
    "sunrise": ("chassis.preset=mecanum", "chassis.wheel_base_m=0.16"),
}
PROFILES = (*FOUR_CHANNEL, *CARS)


def configured(profile: str, *more: str, dialect: str = "") -> Config:
    """A robot with these motors, on the board that they belong to."""
    overrides = [f"board.profile={profile}", *CARS.get(profile, ()), *more]
    if profile in CARS:
        overrides += ["serial.dialect=rosmaster", "odometry.publish_rate_hz=20"]
    elif dialect:
        overrides.append(f"serial.dialect={dialect}")
    return read(None, environ={}, overrides=overrides).config


@dataclass
class TuningBench:
    """A simulated board that stores a bad start.

    Attributes:
        profile: Of its motors.
        start: A row of :data:`STARTS`.
        dialect: Of the board; empty for the one that the motors belong to.
        options: More of the simulated robot.
    """

    profile: str = "520"
    start: str = "as sold"
    dialect: str = ""
    options: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.config = configured(self.profile, dialect=self.dialect)
        base = SimulationOptions(dialect=self.config.serial.dialect.replace("auto", "streamed"))
        robot = msgspec.structs.replace(as_configured(self.config, base), **self.options)
        if robot.flash is not None:
            known = {
                name: value
                for name, value in STARTS[self.start].items()
                if name in robot.flash.__struct_fields__
            }
            robot = msgspec.structs.replace(
                robot, flash=msgspec.structs.replace(robot.flash, **known)
            )
        self.link = LinkBench()
        self.link.robot = SimulatedRobot(robot)
        self.said: list[str] = []
        self.asked: list[BoardSettings] = []
        self.saved: list[BoardSettings] = []

    def procedure(self) -> Procedure:
        """A tuning of it."""
        return Procedure(
            self.link.open,
            self.link.clock,
            self.config,
            speed_m_s=SPEED_M_S,
            say=self.said.append,
        )

    async def agree(self, wanted: BoardSettings, _dialect: Dialect) -> bool:
        """Agree to whatever is asked, and keep it."""
        self.asked.append(wanted)
        return True

    def save(self, _dialect: Dialect, settings: BoardSettings) -> None:
        """Keep what would be saved."""
        self.saved.append(settings)

    async def tune(self) -> Result:
        """All of it."""
        procedure = self.procedure()
        await procedure.examine()
        if procedure.result.worth_writing:
            await procedure.store(self.agree, self.save)
        return procedure.result

    async def true_step(self) -> StepFigures:
        """How the slowest of its wheels to settle truly follows a step."""
        async with Stand.open(self.link.open, self.link.clock, self.config) as stand:
            speed_m_s = min(SPEED_M_S, 0.6 * stand.top_m_s)
            step = asyncio.ensure_future(stand.step(speed_m_s, 1.5))
            while not any(self.link.rim_speeds):
                await asyncio.sleep(TICK_S / 10.0)
            samples = []
            for _ in range(140):
                samples.append(self.link.rim_speeds)
                await asyncio.sleep(TICK_S)
            await step
        signs = [wire.command_sign for wire in self.link.robot.plant.wiring]
        found = [
            figures([sign * each for each in trace], speed_m_s, TICK_S)
            for sign, trace in zip(signs, zip(*samples, strict=True), strict=True)
        ]
        return max(found, key=lambda each: (each.settling_s is None, each.settling_s))
