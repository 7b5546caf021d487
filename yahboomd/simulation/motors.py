"""A motor with its gear, its wheel and its encoder, and their faults.

The law: the supply's share of the output drives against friction. What is left of it sets the rim
speed, linearly and with a first-order lag; an output that friction outweighs brakes; no output at
all lets the wheel coast, downhill on a slope. A wheel at rest, and one that comes through rest,
stays there until the drive exceeds its static friction.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import msgspec

PWM_MAX = 3600
"""Full output, in the board's PWM units."""

COAST_TIME_CONSTANT_S = 0.15
COAST_FRICTION_M_S2 = 0.3

STICKS_BELOW_M_S = 0.004
"""A wheel that friction outweighs stands below this speed, if it has static friction."""


class MotorLaw(msgspec.Struct, frozen=True, kw_only=True):
    """The numbers of one motor.

    Attributes:
        max_speed_m_s: Rim speed at full output.
        dead_zone: Friction while it turns: the output at the rated supply that it takes, in PWM
            units.
        time_constant_s: Lag while it is driven.
        ticks_per_metre: Counts per metre of rim travel.
        stick: Static friction as a multiple of the one while it turns, 1 or more. The break-away
            output is ``stick * dead_zone``, at the rated supply.
    """

    max_speed_m_s: float
    dead_zone: int
    time_constant_s: float
    ticks_per_metre: float
    stick: float = 1.0
    command_sign: int = 1
    encoder_sign: int = 1


class MotorFaults(msgspec.Struct, frozen=True, kw_only=True):
    """The faults of a motor.

    Attributes:
        encoder_dead: The counts stay.
        encoder_reversed: The encoder's two phases are swapped: counts run the other way.
        phases_swapped: The motor's own two wires are swapped: it turns the other way.
        stalled: The wheel is held.
        unplugged: Neither power nor counts pass the cable.
        turning_m_s: The wheel turns at this rim speed, whatever the board does.
        motor_dead: It has no power; its encoder counts.
        mounted_round: It is mounted the other way round: it turns, and counts, the other way.
    """

    encoder_dead: bool = False
    encoder_reversed: bool = False
    phases_swapped: bool = False
    stalled: bool = False
    unplugged: bool = False
    turning_m_s: float | None = None
    motor_dead: bool = False
    mounted_round: bool = False


HEALTHY = MotorFaults()

FAULTS: dict[str, MotorFaults] = {
    "encoder-dead": MotorFaults(encoder_dead=True),
    "encoder-reversed": MotorFaults(encoder_reversed=True),
    "phases-swapped": MotorFaults(phases_swapped=True),
    "stalled": MotorFaults(stalled=True),
    "unplugged": MotorFaults(unplugged=True),
    "turning": MotorFaults(turning_m_s=0.2),
    "motor-dead": MotorFaults(motor_dead=True),
    "mounted-round": MotorFaults(mounted_round=True),
}
"""The faults by the names that the control interface uses."""


def joined(first: MotorFaults, second: MotorFaults) -> MotorFaults:
    """Combine two faults; a value that both set is the second one's."""
    changed = {
        name: value
        for name in MotorFaults.__struct_fields__
        if (value := getattr(second, name)) != getattr(HEALTHY, name)
    }
    return msgspec.structs.replace(first, **changed)


Drive: TypeAlias = tuple[float, float, float]
"""The final rim speed (m/s), its time constant (s), and sliding friction (m/s^2)."""


class MotorState:
    """State of one motor. Rim speeds and travel are true ones, positive forward.

    Attributes:
        supply: The voltage of its supply as a share of the one that its law holds for.
        pull_m_s2: How much the slope under the base accelerates the wheel, positive forward.

    Args:
        phase: Where between two counts the encoder starts, 0 to 1.
    """

    def __init__(self, law: MotorLaw, *, phase: float = 0.0) -> None:
        self.law = law
        self.faults = HEALTHY
        self.pwm = 0
        self.supply = 1.0
        self.pull_m_s2 = 0.0
        self.speed_m_s = 0.0
        self.travel_m = 0.0
        self._encoder_ticks = phase

    @property
    def ticks(self) -> int:
        """The counts of the encoder since the beginning, unbounded."""
        return math.floor(self._encoder_ticks)

    @property
    def at_rest(self) -> bool:
        """Whether it stands and nothing will turn it."""
        return self.speed_m_s == 0.0 and self._drive()[0] == 0.0

    def advance(self, dt_s: float, steps: int = 1) -> list[float]:
        """Turn for steps of ``dt_s`` with the output held; return the rim travel of each in metres.

        The speed is the exact solution of the first-order law over a step, and the travel its
        exact integral.
        """
        if self.faults.stalled:
            self.speed_m_s = 0.0
            return [0.0] * steps
        wanted, time_constant_s, friction = self._drive()
        decay = math.exp(-dt_s / time_constant_s)
        ticks_per_metre = self._ticks_per_metre()
        sticks = self.law.stick > 1.0 and not friction
        travels = []
        for _ in range(steps):
            if friction and self.pull_m_s2:
                # What pulls a wheel that coasts depends on whether it turns.
                wanted, _, _ = self._drive()
            before = self.speed_m_s
            if sticks and before == 0.0:
                wanted, _, _ = self._drive()
            after = wanted + (before - wanted) * decay
            travel = wanted * dt_s + (before - wanted) * time_constant_s * (1.0 - decay)
            if friction:
                # Only sliding friction brings an exponential decay to a standstill.
                slowed = max(0.0, abs(after) - friction * dt_s)
                after = math.copysign(slowed, after) if slowed else 0.0
                travel = (before + after) * 0.5 * dt_s
            elif sticks:
                if before * after < 0.0 or (wanted == 0.0 and abs(after) < STICKS_BELOW_M_S):
                    after = 0.0
            elif wanted == 0.0 and abs(after) < 1e-4:
                after = 0.0
            self.speed_m_s = after
            self.travel_m += travel
            self._encoder_ticks += travel * ticks_per_metre
            travels.append(travel)
        return travels

    def _drive(self) -> Drive:
        law, faults = self.law, self.faults
        if faults.stalled:
            return 0.0, law.time_constant_s, 0.0
        if faults.turning_m_s is not None:
            return faults.turning_m_s, law.time_constant_s, 0.0
        output = 0 if faults.unplugged or faults.motor_dead else self.pwm
        if output == 0:
            steep = abs(self.pull_m_s2) > COAST_FRICTION_M_S2 or self.speed_m_s
            pulled_m_s = self.pull_m_s2 * COAST_TIME_CONSTANT_S if steep else 0.0
            return pulled_m_s, COAST_TIME_CONSTANT_S, COAST_FRICTION_M_S2
        push = abs(output) * self.supply
        stands = law.stick > 1.0 and self.speed_m_s == 0.0
        if push <= law.dead_zone * (law.stick if stands else 1.0):
            return 0.0, law.time_constant_s, 0.0
        share = (push - law.dead_zone) / (PWM_MAX - law.dead_zone)
        sign = law.command_sign * (-1 if faults.phases_swapped != faults.mounted_round else 1)
        driven_m_s = math.copysign(share * law.max_speed_m_s, output * sign)
        return (
            driven_m_s + self.pull_m_s2 * law.time_constant_s,
            law.time_constant_s,
            0.0,
        )

    def _ticks_per_metre(self) -> float:
        faults = self.faults
        if faults.encoder_dead or faults.unplugged:
            return 0.0
        reversed_ = faults.encoder_reversed != faults.mounted_round
        sign = self.law.encoder_sign * (-1 if reversed_ else 1)
        return self.law.ticks_per_metre * sign
