"""Moves the robot along known shapes, within announced bounds, and gathers its counts."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from yahboomd.core.clock import Clock, PauseWatch, SystemClock, nanoseconds, seconds
from yahboomd.core.errors import NoDaemon, Refused
from yahboomd.core.messages.native import EventSample, ImuSample, StatusSample, WheelsSample
from yahboomd.core.model import NS_PER_S
from yahboomd.core.standstill import HUNTS_M
from yahboomd.tools.calibrate.estimates.runs import Floats
from yahboomd.tools.robot.obedience import Obedience
from yahboomd.tools.terminal.asking import LargestMove

if TYPE_CHECKING:
    from yahboomd.client import AsyncRobot, Samples
    from yahboomd.core.config import Config
    from yahboomd.tools.calibrate.hold import HeldButton

DAEMON_WITHIN_S = 8.0
"""A daemon that publishes no wheels and does not answer for this time does not run. It is this long
because a person has put the robot on its mark, and the daemon may be busy."""

REST_NS = NS_PER_S // 2
"""If the counts have not moved within this time, the wheels do not roll any more."""

STANDS_WITHIN_NS = 20 * NS_PER_S

RAMP_S = 5.0
"""How long the speed of a leg that looks for the break-away takes to grow to the leg's, unless all
wheels count before."""

BEGUN_COUNTS = 3
"""A wheel that counted more has begun to turn: an edge of the encoder may flicker."""


class Sides:
    """Converts the ticks of single motors to the travel of the two sides, with nominal radii.

    A mecanum base turns as if its sides were as far apart as its wheels and its axles together.

    Args:
        names: The motors, in the order of the ticks.
    """

    def __init__(self, config: Config, names: Sequence[str]) -> None:
        from yahboomd.core.config.calibration_file import geometry_of

        geometry = geometry_of(config)
        per_tick = 2.0 * np.pi * geometry.wheel_radius_m / geometry.ticks_per_revolution
        wheels = config.kinematics().wheels
        side = {motor.name: wheels[motor.wheel] for motor in config.motors()}
        self._weights = np.zeros((2, len(names)))
        for row, which in enumerate(("left", "right")):
            mine = [i for i, name in enumerate(names) if side[name].endswith(which)]
            self._weights[row, mine] = per_tick / len(mine)
        self.separation_m = geometry.wheel_separation_m
        self._hunts_ticks = max(1.0, HUNTS_M / per_tick)
        kinematics = config.kinematics()
        self._to_the_left = np.zeros(len(names))
        if kinematics.holonomic:
            self.separation_m += config.chassis.wheel_base_m or 0.0
            across = dict(zip(kinematics.wheels, kinematics.forward[1], strict=True))
            self._to_the_left = np.array([np.sign(across[side[name]]) for name in names]) * (
                per_tick / len(names)
            )

    def travel(self, ticks: Sequence[Sequence[int]]) -> tuple[Floats, Floats]:
        """The travel of the left and the right side between the readings, metres."""
        steps = np.diff(np.array(ticks, dtype=float), axis=0) @ self._weights.T
        return steps[:, 0], steps[:, 1]

    def moved(self, before: Sequence[int], after: Sequence[int]) -> bool:
        """Whether a wheel turned farther than one that the board holds."""
        return any(
            abs(new - old) > self._hunts_ticks for new, old in zip(after, before, strict=True)
        )

    def to_the_left(self, ticks: Sequence[Sequence[int]]) -> Floats:
        """The travel of a mecanum base to the left between the readings, metres, without slip."""
        steps: Floats = np.diff(np.array(ticks, dtype=float), axis=0) @ self._to_the_left
        return steps


class Leg:
    """A part of a shape: a straight of some metres, or a turn in place of some radians.

    Args:
        vx: Forward, m/s.
        wz: Counter-clockwise, rad/s.
        amount: Metres, or radians.
        vy: To the left, m/s.
        ramps: Begin slowly, to find the break-away: the speed at which all wheels turn.
    """

    def __init__(
        self, vx: float, wz: float, amount: float, *, vy: float = 0.0, ramps: bool = False
    ) -> None:
        self.ramps = ramps
        self.vx = vx
        self.vy = vy
        self.wz = wz
        self.amount = amount

    @property
    def limit_s(self) -> float:
        """The longest time that it may take, ramps and a weak battery included."""
        more_s = RAMP_S if self.ramps else 0.0
        return 1.5 * self.amount / max(abs(self.vx), abs(self.vy), abs(self.wz)) + 5.0 + more_s

    def done(
        self, left_m: float, right_m: float, separation_m: float, *, to_the_left_m: float = 0.0
    ) -> float:
        """The part of it that the robot has done, by the counts."""
        if self.vy:
            return to_the_left_m * (1.0 if self.vy > 0.0 else -1.0)
        if self.vx:
            return (left_m + right_m) / 2.0 * (1.0 if self.vx > 0.0 else -1.0)
        return (right_m - left_m) / separation_m * (1.0 if self.wz > 0.0 else -1.0)


class Interrupted(Exception):
    """The robot was stopped in mid-run, and may be driven again; the text has the reason."""


LET_GO = "The button was let go, or the connection was too slow: the robot stopped."
LOST = (
    "The daemon was lost for a moment, or this machine was too busy to command it: the robot "
    "stopped."
)


class LegDriver:
    """Drives legs and gathers counts.

    Args:
        hold: The button that lets the robot move; None: it moves without one.
    """

    def __init__(
        self,
        robot: AsyncRobot,
        config: Config,
        source: str,
        hold: HeldButton | None = None,
        clock: Clock | None = None,
    ) -> None:
        self._clock = clock or SystemClock()
        self._robot = robot
        self._config = config
        self._source = source
        self._hold = hold
        self._samples: Samples[WheelsSample] = robot.samples(WheelsSample, depth=4096)
        self._lost = ""
        robot.on(EventSample, self._notice)
        robot.on(ImuSample, self._turn)
        self._gyro_ns: int | None = None
        self.gyro_rad = 0.0
        """The turn since :meth:`begin` by the gyro; 0 without one."""
        self.break_away = dict.fromkeys(("ways", "turns"), 0.0)
        """The speeds at which all wheels had begun to turn, the largest of the ramps; 0: none."""
        self._ticks: list[tuple[int, ...]] = []
        self._stood: tuple[int, ...] | None = None
        self._stamp_ns = self._changed_ns = 0
        self.sides: Sides | None = None

    def _notice(self, event: EventSample) -> None:
        if event.kind == "odometry_discontinuity":
            self._lost = event.message

    def _turn(self, sample: ImuSample) -> None:
        since_ns = 0 if self._gyro_ns is None else sample.stamp_ns - self._gyro_ns
        self._gyro_ns = sample.stamp_ns
        if 0 < since_ns < NS_PER_S // 5:
            turn = sample.gyro_rad_s[2] - sample.gyro_bias_rad_s
            self.gyro_rad += turn * seconds(since_ns)

    def bounds(self, legs: Sequence[Leg]) -> LargestMove:
        """The most that the robot moves in these legs."""
        return LargestMove(
            distance_m=sum(leg.amount for leg in legs if leg.vx or leg.vy),
            turn_rad=float(sum(leg.amount for leg in legs if leg.wz)),
            time_s=sum(leg.limit_s for leg in legs),
        )

    async def _next(self) -> Sides:
        try:
            async with asyncio.timeout(DAEMON_WITHIN_S):
                sample = await anext(self._samples)
        except (TimeoutError, StopAsyncIteration):
            raise NoDaemon(
                "No counts come from the daemon: is the board connected?",
                remedy="`yahboomd status` shows its state.",
            ) from None
        if self.sides is None:
            self.sides = Sides(self._config, sample.names)
        if self._stood is None or self.sides.moved(self._stood, sample.ticks):
            self._stood, self._changed_ns = sample.ticks, sample.stamp_ns
        self._ticks.append(sample.ticks)
        self._stamp_ns = sample.stamp_ns
        return self.sides

    async def begin(self, asked: Coroutine[Any, Any, None]) -> None:
        """Wait until the robot stands, then discard the gathered counts.

        Args:
            asked: A question to wait for first; the robot may be pushed onto its mark meanwhile.
        """
        waiting = asyncio.create_task(asked)
        try:
            while not waiting.done():
                await self._next()
                # An open question may wait for days.
                del self._ticks[:-1]
            await waiting
        finally:
            waiting.cancel()
        await self._rest()
        del self._ticks[:-1]
        self._lost, self.gyro_rad = "", 0.0

    async def _rest(self) -> None:
        """Gather until no wheel has moved for a while."""
        await self._next()
        begin_ns = self._stamp_ns
        while self._stamp_ns - self._changed_ns < REST_NS:
            await self._next()
            if self._stamp_ns - begin_ns > STANDS_WITHIN_NS:
                raise Refused("The wheels do not come to rest: nothing was written.")

    async def drive(self, leg: Leg, progress: Callable[[float], None]) -> None:
        """Drive one leg, and wait until the robot stands.

        Args:
            progress: Called with the share that was driven, from 0 to 1.

        Raises:
            Interrupted: The person let go of the button, the command ended by itself, the board
                sent no counts for a moment, or some counts are lost.
            Refused: The robot does not obey, or makes no progress.
            NoDaemon: The daemon was lost.
        """
        before = await self._robot.get(StatusSample, timeout_s=DAEMON_WITHIN_S)
        if before is None:
            raise Refused("The daemon has published no status yet: nothing was driven.")
        obedience = Obedience(self._source, before)
        if trouble := obedience.trouble_before():
            raise Refused(f"Nothing was driven. {trouble}")
        first, seen = self._ticks[-1], before.stamp_ns
        command = _LegCommand(self._robot, leg, self._hold, self._clock)
        progress(0.0)
        try:
            while True:
                command.go_on()
                sides = await self._next()
                ticks = [first, self._ticks[-1]]
                if command.ramps and min(map(abs, map(int.__sub__, *ticks))) > BEGUN_COUNTS:
                    self._found(leg, command.share())
                    command.ramps = False
                left, right = map(float, np.concatenate(sides.travel(ticks)))
                beside = float(sides.to_the_left(ticks)[0])
                done = leg.done(left, right, sides.separation_m, to_the_left_m=beside) / leg.amount
                if done >= 1.0:
                    break
                progress(max(0.0, done))
                status = self._robot.newest(StatusSample)
                if status is not None and status.stamp_ns != seen:
                    seen = status.stamp_ns
                    if status.state == "waiting":
                        raise Interrupted(f"The robot stopped by itself. {status.why}")
                    if trouble := obedience.trouble(status):
                        raise Refused(f"The robot does not obey. {trouble}")
        finally:
            self._robot.stop()
        progress(1.0)
        await self._robot.finished()
        await self._rest()
        if self._lost:
            raise Interrupted(self._lost)

    def _found(self, leg: Leg, share: float) -> None:
        name = "turns" if leg.wz else "ways"
        speed = share * abs(leg.wz or leg.vx)
        self.break_away[name] = max(self.break_away[name], speed)

    def gathered(self) -> tuple[Floats, Floats, float]:
        """The travel of both sides since :meth:`begin`, in steps, and the nominal separation."""
        assert self.sides is not None
        return (*self.sides.travel(self._ticks), self.sides.separation_m)

    def gathered_sideways(self) -> tuple[Floats, Floats, Floats]:
        """The travel ahead, to the left, and the turn, in steps, with nominal sizes."""
        left, right, separation_m = self.gathered()
        assert self.sides is not None
        turn: Floats = (right - left) / separation_m
        return (left + right) / 2.0, self.sides.to_the_left(self._ticks), turn


STILL_S = 0.5
"""The daemon stops the robot after this time without a command."""


class _LegCommand:
    """The command of one leg: it ends with the leg's time, and with the person's hold."""

    def __init__(self, robot: AsyncRobot, leg: Leg, hold: HeldButton | None, clock: Clock) -> None:
        self.ramps = leg.ramps
        self._begun_ns = clock.now_ns()
        self._clock = clock
        self._robot = robot
        self._leg = leg
        self._hold = hold
        self._ends_ns = clock.now_ns() + nanoseconds(leg.limit_s)
        self._pauses = PauseWatch(clock, nanoseconds(STILL_S))
        if hold is None:
            self._drive(leg.limit_s)

    def share(self) -> float:
        """The share of the leg's speed that is commanded."""
        if not self.ramps:
            return 1.0
        return min(1.0, seconds(self._clock.now_ns() - self._begun_ns) / RAMP_S)

    def _drive(self, for_s: float) -> None:
        leg, share = self._leg, self.share()
        self._robot.drive(share * leg.vx, share * leg.wz, vy=share * leg.vy, for_s=for_s)
        self._driven = share

    def go_on(self) -> None:
        """Continue the command.

        Raises:
            Interrupted: The person let go, or the command ended by itself.
            Refused: The leg's time is over.
        """
        held_s = None if self._hold is None else self._hold.left_s()
        if held_s is not None and held_s <= 0.0:
            raise Interrupted(LET_GO)
        left_s = seconds(self._ends_ns - self._clock.now_ns())
        if left_s <= 0.0:
            raise Refused(
                f"After {self._leg.limit_s:.0f} s the robot was not where its counts should "
                "be, and was stopped: do all wheels turn, and the right way round?"
            )
        if held_s is not None:
            # A hold from before a pause, such as a suspend, must not drive on.
            if self._pauses.detect() is not None:
                raise Interrupted(LOST)
            self._drive(min(held_s, left_s))
        elif self._robot.commanded is None:
            raise Interrupted(LOST)
        elif self._driven < 1.0:
            self._drive(left_s)


def straight(metres: float, speed: float, *, ramps: bool = False) -> list[Leg]:
    """One straight."""
    return [Leg(speed, 0.0, metres, ramps=ramps)]


def sideways(metres: float, speed: float) -> list[Leg]:
    """To the side; negative is to the right."""
    return [Leg(0.0, 0.0, abs(metres), vy=speed if metres > 0.0 else -speed)]


def turns(radians: float, speed: float) -> list[Leg]:
    """Turns in place; negative is clockwise."""
    return [Leg(0.0, speed if radians > 0.0 else -speed, abs(radians), ramps=True)]


def square(side: float, speed: float, turn_speed: float, *, left: bool) -> list[Leg]:
    """A square that ends at its start, heading included."""
    around = turn_speed if left else -turn_speed
    return [leg for _ in range(4) for leg in (Leg(speed, 0.0, side), Leg(0.0, around, np.pi / 2))]
