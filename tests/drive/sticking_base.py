"""A base on a floor that holds its wheels, with the boards' own speed loops, on a clock of its own.

The wheels are the simulated robot's; the loop has the vendors' gain unless another is given.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

from yahboomd.core.drive.faults import Fault
from yahboomd.core.drive.follow_check import FollowCheck
from yahboomd.core.drive.loop_law import loop_law
from yahboomd.core.drive.wheel_follower import WheelFollower
from yahboomd.simulation.motors import MotorFaults, MotorLaw, MotorState
from yahboomd.simulation.options import PLAIN_GAIN
from yahboomd.simulation.speed_loop import LoopSettings, SpeedLoop

MS = 1_000_000
TICK_M = 2 * math.pi * 0.0335 / 1320
AS_SOLD = (0.8, 0.06, 0.5)
TUNED = (3.2, 0.24, 2.0)


def believing(motors: Sequence[str], **options: float) -> FollowCheck:
    """A check that believes each speed, whatever the counts are."""
    check = FollowCheck(motors, [TICK_M] * len(motors), **options)
    for wheel in check._wheels:
        wheel._witnessed = partial(getattr, wheel, "measured_m_s")
    return check


def follower(latency_ns: int = 0) -> WheelFollower:
    """A wheel whose speeds are believed."""
    wheel = WheelFollower("left", 0.08, latency_ns, TICK_M, lambda: wheel.measured_m_s)
    return wheel


class StickingBase:
    """Wheels, their loops and the check.

    Args:
        frictions: Of each wheel that turns, as a share of full output at the rated supply.
        stick: Static friction as a multiple of it.
        supply: The battery as a share of the rated supply.
        gains: P, I and D, which the board stores.
        period_ms: From one reading to the next.
        order: Whose counts each wheel's encoder input gets.
    """

    def __init__(
        self,
        frictions: Sequence[float],
        *,
        stick: float = 1.2,
        supply: float = 0.875,
        gains: tuple[float, float, float] = AS_SOLD,
        period_ms: int = 20,
        min_speed_m_s: float = 0.08,
        order: Sequence[int] | None = None,
    ) -> None:
        names = ["front_left", "rear_left", "front_right", "rear_right"][: len(frictions)]
        self.check = FollowCheck(
            names, [TICK_M] * len(names), min_speed_m_s=min_speed_m_s, latency_s=0.02
        )
        self.check.law = loop_law({"pid": gains, "dead_zone": 1600})
        p, i, d = gains
        self._settings = LoopSettings(
            mm_s_per_tick=TICK_M * 1e5, p=p, i=i, d=d, dead_zone=1600, most_output=2000
        )
        self.wheels = [
            MotorState(
                MotorLaw(
                    max_speed_m_s=1.15,
                    dead_zone=round(3600 * friction),
                    time_constant_s=0.06,
                    ticks_per_metre=1 / TICK_M,
                    stick=stick,
                )
            )
            for friction in frictions
        ]
        for wheel in self.wheels:
            wheel.supply = supply
        self._loops = [SpeedLoop(PLAIN_GAIN) for _ in frictions]
        self._order = list(order or range(len(frictions)))
        self._period_ms = period_ms
        self._seen = self._read = [0] * len(frictions)
        self._let_go = True
        self.now_ms = 0

    def break_wheel(self, index: int, **faults: float | bool) -> None:
        self.wheels[index].faults = MotorFaults(**faults)  # type: ignore[arg-type]

    def drive(self, speeds: Sequence[float] | float, seconds: float) -> list[Fault]:
        """Drive until the time is over, or wheels are let go for a fault, and have rolled out."""
        if isinstance(speeds, float):
            speeds = [speeds] * len(self.wheels)
        self._let_go = False
        self.check.command(self.now_ms * MS, list(speeds))
        until_ms, found = self.now_ms + round(seconds * 1e3), list[Fault]()
        while self.now_ms < until_ms and not self._let_go:
            found += self._step(speeds)
            if any(fault.action != "report" for fault in found):
                self.let_go()
        return found

    def let_go(self) -> None:
        """Let the wheels go, and roll out."""
        self._let_go = True
        self.check.command(self.now_ms * MS, None)
        for loop in self._loops:
            loop.reset()
        for _ in range(60):
            self._step([0.0] * len(self.wheels))

    def _step(self, speeds: Sequence[float]) -> list[Fault]:
        ticks = [self.wheels[index].ticks for index in self._order]
        for wheel, loop, speed, now, before in zip(
            self.wheels, self._loops, speeds, ticks, self._seen, strict=True
        ):
            loop.target_mm_s = round(speed * 1e3)
            measured = (now - before) * self._settings.mm_s_per_tick
            wheel.pwm = 0 if self._let_go else loop.next_output(measured, self._settings)
            wheel.advance(0.01)
        self._seen = ticks
        self.now_ms += 10
        if self.now_ms % self._period_ms >= 10:
            return []
        counts = [now - before for now, before in zip(ticks, self._read, strict=True)]
        self._read = ticks
        measured_m_s = [count * TICK_M * 1e3 / self._period_ms for count in counts]
        return list(self.check.measure(self.now_ms * MS, measured_m_s, counts))

    @property
    def travels_m(self) -> list[float]:
        return [wheel.travel_m for wheel in self.wheels]
