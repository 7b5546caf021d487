"""Moves on simulated robots, in virtual time, without a bus: driven, and judged by the truth."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

from robot_bench import RobotBench

from yahboomd.client.move_messages import Move
from yahboomd.core.messages.codecs import encode
from yahboomd.core.messages.native import VelocityCommand
from yahboomd.core.model import Pose2d
from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.moves.motion.base_limits import Base, base_of
from yahboomd.moves.motion.lag_model import LagModel
from yahboomd.moves.motion.mover import MoveEnd, Mover
from yahboomd.moves.move_keeper import UNCERTAIN_M
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.rosmaster.rosmaster_flash import RosmasterStored

TRACK_M, BASE_M = 0.15, 0.13
CAR_TRACK_M, CAR_BASE_M = 0.1911, 0.23537
LONGEST_S = 120.0
DRIVES = {"mecanum": "mecanum", "4wd": "skid_steer", "ackermann": "ackermann"}
PRESETS = {"2wd": "differential", "4wd": "skid_steer", "mecanum": "mecanum"}
CARS = {"x3": ("mecanum", 1), "x1": ("4wd", 4), "r2": ("ackermann", 5)}
"""For each model of a Rosmaster board the preset of its chassis, and its car type."""


class Drive(NamedTuple):
    """One drive of a list of moves.

    Attributes:
        ended: Why it ended.
        time_s: How long it took, and how long the ideal profiles do.
        begin: The true pose at its begin, and the true pose after it, standing.
        path: The true poses on the way.
        past_m: How far behind the end the base was on a leg, at most, along it (m, or rad).
    """

    ended: MoveEnd
    time_s: float
    ideal_s: float
    begin: Pose2d
    end: Pose2d
    path: list[Pose2d]
    past: float

    @property
    def ahead_m(self) -> float:
        """The way along the heading at the begin."""
        dx, dy = self.end.x - self.begin.x, self.end.y - self.begin.y
        return math.cos(self.begin.theta) * dx + math.sin(self.begin.theta) * dy

    @property
    def left_m(self) -> float:
        dx, dy = self.end.x - self.begin.x, self.end.y - self.begin.y
        return math.cos(self.begin.theta) * dy - math.sin(self.begin.theta) * dx

    @property
    def turned_rad(self) -> float:
        return self.end.theta - self.begin.theta


class MoveBench(RobotBench):
    """A simulated robot that drives moves.

    Args:
        preset: ``2wd``, ``4wd`` or ``mecanum``; or a model of a Rosmaster board: ``x3``, ``x1``, or
            ``r2``, the car that steers.
        lag_s: The time constant of its motors.
        more: Of the configuration, as for ``--set``.
    """

    def __init__(
        self,
        folder: Path,
        preset: str = "2wd",
        lag_s: float = 0.1,
        more: Sequence[str] = (),
        **simulation: object,
    ) -> None:
        drive, overrides = PRESETS.get(preset, ""), [f"chassis.preset={preset}"]
        options: dict[str, Any] = {}
        if preset in CARS:
            of_car, car_type = CARS[preset]
            profile = PROFILES[preset]
            drive = DRIVES[of_car]
            overrides = [
                *(f"chassis.preset={of_car}", f"board.profile={preset}"),
                f"chassis.wheel_separation_m={CAR_TRACK_M}",
            ]
            if of_car != "4wd":
                overrides.append(f"chassis.wheel_base_m={CAR_BASE_M}")
            options = {
                "dialect": "rosmaster",
                "flash": RosmasterStored(car_type=car_type),
                "lines": profile.lines,
                "ratio": profile.ratio,
                "wheel_radius_m": profile.wheel_radius_m,
                "start_up_s": 0.5,
            }
        elif preset == "mecanum":
            overrides.append(f"chassis.wheel_base_m={BASE_M}")
        options = {
            "drive": drive,
            "wheel_separation_m": CAR_TRACK_M if preset in CARS else TRACK_M,
            "wheel_base_m": CAR_BASE_M if preset in CARS else BASE_M,
            "time_constant_s": lag_s,
            "rated_volts": 12.0,
            "battery_volts": 12.0,
            "motor_dead_zone": 1660,
            **options,
            **simulation,
        }
        super().__init__(folder, [*overrides, *more], SimulationOptions(**options))
        self.lag = LagModel()
        self.uncertain_m = UNCERTAIN_M
        self._watched = 0

    def slip(self, least: float, most: float, seed: int) -> None:
        """Let each wheel lose a share of its way between these two, another one each second."""
        chance = Random(seed)
        chassis = self.robot.plant.chassis
        body, until = chassis.body, [0.0]
        losses: list[float] = []

        def slipping(rims: list[float]) -> tuple[float, float, float]:
            now_s = self.clock.now_ns() / 1e9
            if now_s >= until[0] or len(losses) != len(rims):
                until[0] = now_s + 1.0
                losses[:] = [chance.uniform(least, most) for _ in rims]
            return body([way * (1.0 - lost) for way, lost in zip(rims, losses, strict=True)])

        chassis.body = slipping  # type: ignore[method-assign]

    @property
    def base(self) -> Base:
        return base_of(self.config.resolved().as_data())

    @property
    def truth(self) -> Pose2d:
        """Where it truly is."""
        self.robot.advance(self.clock.now_ns())
        return self.robot.plant.chassis.pose

    def ideal_s(self, move: Move, begin: Pose2d) -> float:
        """The time of the ideal profiles of a move."""
        return Mover([move], begin, self.base, LagModel()).time_s

    def _watch(self, mover: Mover) -> None:
        """What the service does with each sample of the inertial sensor, and of the pose."""
        newest = self.heard.estimates[-1]
        for sample in self.heard.imu_estimates[self._watched :]:
            turn = sample.reading.gyro_rad_s[2] - sample.bias_rad_s
            if differs := mover.watch.disagree(newest.twist.wz, turn, sample.stamp_ns):
                mover.end(*differs)
        self._watched = len(self.heard.imu_estimates)
        if mover.watch.uncertain(newest.pose_covariance, self.uncertain_m):
            mover.end("uncertain", "The place is uncertain.")

    async def move(self, moves: Sequence[Move], *, base: Base | None = None) -> Drive:
        """Drive moves to their end, and wait until the base stands."""
        begin = self.truth
        mover = Mover(moves, self.heard.estimates[-1].pose, base or self.base, self.lag)
        began_ns = self.clock.now_ns()
        path: list[Pose2d] = []
        past = -math.inf
        while mover.ended is None:
            await asyncio.sleep(0.02)
            assert self.clock.now_ns() - began_ns < LONGEST_S * 1e9, "it never ends"
            pose = self.heard.estimates[-1].pose
            self._watch(mover)
            twist = mover.step(pose, self.clock.now_ns())
            if mover._leg is not None and mover._leg._last:
                past = max(past, -mover._leg.left(pose))
            if twist is not None:
                command = VelocityCommand(vx=twist.vx, vy=twist.vy, wz=twist.wz)
                self.payload(encode(command, "json"))
            path.append(self.truth)
        time_s = (self.clock.now_ns() - began_ns) / 1e9
        for _ in range(20):
            self.command()
            await asyncio.sleep(0.02)
            self.lag.advance(0.02)
        return Drive(
            ended=mover.ended,
            time_s=time_s,
            ideal_s=mover.time_s,
            begin=begin,
            end=self.truth,
            path=path,
            past=past,
        )
